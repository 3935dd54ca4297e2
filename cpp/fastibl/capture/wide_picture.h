// Turns pictures of fisheye and 360° cameras into perspective ones, the only ones that the
// measurement of light reads.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/capture/picture_mask.h"
#include "fastibl/core/image.h"
#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

// One side of a cube around the camera, of those that its picture shows. Each pixel is the nearest
// one of the wide picture, so codes, clipping and noise stay the same.
struct WideSide {
  struct Source {
    std::int32_t x, y;  // pixel of the wide picture; −1 where that shows nothing
  };
  Camera camera;                // without vignetting; for that see `vignette`
  std::vector<float> vignette;  // of each pixel; empty for none
  Pose side_from_camera;        // turns only
  std::vector<Source> from;     // of each pixel
  Image<std::uint8_t> own;      // 1 in the side proper, without a margin for footprints
};

// texels: along an edge of a face of the map. Throws std::invalid_argument for a perspective
// camera.
std::vector<WideSide> sides_of(const Camera& wide, int texels);

// The part of a picture that a side shows. Memory is kept from picture to picture.
class SidePicture {
 public:
  // mask: as for Capture, of the wide picture.
  void take(const WideSide& side, const Picture& wide, ImageView<const std::uint8_t> mask);
  const Picture& picture() const { return picture_; }
  ImageView<const std::uint8_t> mask() const { return mask_; }
  const PictureMask& hidden() const { return hidden_; }  // what the mask that was given hides

 private:
  Picture picture_;
  ImageView<const std::uint8_t> mask_;
  std::vector<std::uint8_t> pixels_;
  Image<std::uint8_t> masked_;
  PictureMask hidden_;
};

}  // namespace fastibl
