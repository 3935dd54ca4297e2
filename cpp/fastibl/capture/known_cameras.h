// What is remembered of the cameras whose pictures are taken into a map.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "fastibl/capture/camera_side.h"
#include "fastibl/capture/exposure_doubt.h"
#include "fastibl/capture/row_poses.h"
#include "fastibl/capture/wide_picture.h"
#include "fastibl/core/image.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

// A picture of any camera, as it was given.
struct GivenPicture {
  const Picture& picture;
  RowPoses poses;                      // camera_from_marker
  ImageView<const std::uint8_t> mask;  // as for Capture
};

class KnownCamera {
 public:
  // number: distinguishes cameras with the same parameters. texels: along an edge of a face of the
  // map.
  KnownCamera(const Camera& camera, int number, int texels);

  bool is(const Camera& other, int other_number) const {
    return number_ == other_number && camera_ == other;
  }
  bool perspective() const { return camera_.model == CameraModel::perspective; }
  const Camera& camera() const { return camera_; }
  // Visits what each side shows of a picture, which is valid until the next one is visited.
  template <class Visit>
  void each_side(const GivenPicture& given, const Visit& visit) {
    if (perspective()) {
      const PictureMask hidden(given.mask);
      visit(PosedPicture{given.picture, sides_.front(), given.poses, given.mask, hidden});
    }
    for (std::size_t i = 0; i < wide_.size(); ++i) {
      shown_.take(wide_[i], given.picture, given.mask);
      const RowPoses poses(wide_[i].side_from_camera * given.poses.at(0.5));
      visit(PosedPicture{shown_.picture(), sides_[i], poses, shown_.mask(), shown_.hidden()});
    }
  }

  std::int64_t used = 0;  // when it was last used, counted in pictures
  int first = 0;          // the camera's number in order of appearance, from 1
  ExposureDoubt doubt;
  bool metered = false;  // whether the board's white was read in its pictures

  // For when a picture had this exposure. True if none was much shorter: what clips here will clip.
  bool note_exposure(double exposure);
  bool brackets() const;  // whether its exposures differ by steps of a bracket

 private:
  Camera camera_;
  int number_;
  std::vector<WideSide> wide_;  // of a fisheye or 360° camera
  SidePicture shown_;
  std::vector<CameraSide> sides_;  // one for each of these, or that of a perspective camera
  double shortest_ = std::numeric_limits<double>::infinity(), longest_ = 0;  // exposures
};

class KnownCameras {
 public:
  // The camera with these parameters, which stays valid until another one is asked for. Throws
  // std::invalid_argument for a new one that is not valid.
  KnownCamera& get(const Camera& camera, int number, int texels);
  // Whether all that any camera showed, also of those that were forgotten, is in an assumed scale.
  bool any_assumed() const;
  bool any_brackets() const;

 private:
  template <class Is>
  bool any(const Is& is) const;

  std::vector<KnownCamera> perspective_, wide_;
  std::int64_t used_ = 0;        // pictures
  int known_ = 0;                // cameras so far
  bool forgot_assumed_ = false;  // a camera whose scale was assumed
};

}  // namespace fastibl
