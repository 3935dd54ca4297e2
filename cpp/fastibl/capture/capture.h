// From camera pictures with known poses to the light of the place.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "fastibl/capture/assumed_scale.h"
#include "fastibl/capture/capture_options.h"
#include "fastibl/capture/exposure_doubt.h"
#include "fastibl/capture/frame_levels.h"
#include "fastibl/capture/known_cameras.h"
#include "fastibl/capture/light_changes.h"
#include "fastibl/capture/map_fills.h"
#include "fastibl/capture/map_snapshots.h"
#include "fastibl/capture/map_tiles.h"
#include "fastibl/capture/next_exposure.h"
#include "fastibl/capture/picture_taker.h"
#include "fastibl/capture/place_layout.h"
#include "fastibl/capture/plane_meter.h"
#include "fastibl/capture/tile_views.h"
#include "fastibl/core/image.h"
#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

// Measures the environment: every picture updates the texels that it sees. Above the horizon light
// comes from `distance`; below it a texel is the point of the opaque marker plane that `centre`
// sees there.
//
// Each channel of a texel is a value with a variance (a Kalman filter per texel). The noise of the
// sensor and of quantisation, and the variance's growth with time, decide how much a new sample
// counts; a sample that contradicts the value replaces it. A clipped sample is a lower bound: it
// raises a value below it, agrees with a value above it and never lowers one.
//
// A tile that a picture could hardly improve, and that agrees with it, is left out for up to five
// pictures: see QuietTiles. Its texels then count as last seen when they were last updated.
class Capture {
 public:
  explicit Capture(
      CaptureOptions options = {});  // throws std::invalid_argument for options out of range

  // Takes a picture into the map.
  // exposure: std::nullopt if it is not known; the map then gives it, see Taken. time: seconds, not
  // decreasing. mask: one byte a pixel, 0 where the picture shows what is not part of the place;
  // empty for none. last_row: for a rolling shutter, the pose when the picture's last row was
  // taken; camera_from_marker is then that of the first row (for fisheye and 360° cameras the pose
  // half-way is used). tint: by channel, a known factor on the exposure, for another camera's white
  // balance and scale. plane: false if the camera's place is a guess; what was seen of the plane
  // otherwise then stays. number: distinguishes cameras with the same parameters. Throws
  // std::invalid_argument for a picture or mask of another size than the camera's, an exposure that
  // is not positive and finite, or a time before the last one.
  Taken add(const Picture& picture, const Camera& camera, const Pose& camera_from_marker,
            std::optional<double> exposure, double time, ImageView<const std::uint8_t> mask = {},
            const std::optional<Pose>& last_row = {}, const glm::dvec3& tint = glm::dvec3(1),
            bool plane = true, int number = 0);

  // For when the marker was turned: what is above the horizon turns with new_from_old, and so does
  // the prior; lights must be located anew, and the plane is forgotten. What the board's white
  // showed of the light stays, unless the plane is tilted by more than 5 degrees.
  void turn(const glm::dmat3& new_from_old);

  // Whether pictures tell from now on how far things are, where neither a distance nor a box was
  // given. What was found stays; a map of which nothing was seen takes all light to be distant.
  void find_distance(bool find) { place_.find_distance(find); }

  // The map at the time of the last picture, without holes: unseen texels take a mean of what was
  // seen near them on their side of the horizon, at confidence 0 and up to a second late. An
  // earlier map that nobody holds any more is reused: only what changed since then is made anew.
  std::shared_ptr<const Environment> environment();

  // The exposure with which a perspective camera at this pose shows most of what the map lacks:
  // shorter where texels were never seen without clipping, longer where they are dark and noisy.
  // Throws std::invalid_argument for another camera model, or an invalid range.
  double next_exposure(const Camera& camera, const Pose& camera_from_marker,
                       const ExposureRange& range) const;

  int size() const { return options_.size; }
  // Metres to what is seen above the horizon: as given, or as the pictures say so far. Without
  // meaning where there is a box.
  double distance() const { return surface().distance(); }
  const MapSurface& surface() const { return place_.surface(); }
  const glm::dvec3& centre() const { return options_.centre; }
  double time() const { return time_; }
  // How often everything that a camera without told exposures had shown was made brighter or darker
  // as a whole, so that the sky lights the board as its white says.
  int mended() const { return scale_.mended(); }
  // How often the map changed: by pictures that were not left out, and by turns.
  int changes_made() const { return changes_made_; }
  // 6 n²: time at which each texel was last seen; −∞ if never.
  std::vector<double> last_seen() const { return map_.last_seen(); }

 private:
  // How bright a picture is taken to be, by the exposure that came with it and what the map knows.
  Taken judge(const GivenPicture& given, std::optional<double> exposure, const glm::dvec3& tint,
              bool plane, KnownCamera& known);
  std::optional<double> assumed_exposure(const GivenPicture& given, KnownCamera& known, bool plane);
  // Notes that all of the map may be wrong by this factor, ln by channel.
  void distrust(const glm::dvec3& log_change);
  // Whether what clips in this picture clips in every exposure, as far as is known.
  bool clips_in_all(const Taken& taken, KnownCamera& known) const;
  double most_boost() const;
  double scale_error() const;
  // True if the picture shows the board's white well enough.
  bool read_meter(const PosedPicture& posed, KnownCamera& known, const Taken& taken);
  // Learns where things are, and moves what the map knows of them there.
  void learn_layout(const PosedPicture& posed, const Taking& how);

  CaptureOptions options_;
  int changes_made_ = 0;
  double time_ = -1e30;
  std::optional<Camera> last_camera_;
  KnownCameras cameras_;
  MapTiles map_;
  TileViews views_;
  PlaceLayout place_;
  MapFills fills_;
  PlaneMeter meter_;
  AssumedScale scale_;
  LightChanges changes_;
  FrameLevels levels_;
  MapSnapshots snapshots_;
};

}  // namespace fastibl
