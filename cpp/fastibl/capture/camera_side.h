// A perspective camera, or one side of a fisheye or 360° camera, and a picture of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/capture/picture_mask.h"
#include "fastibl/capture/row_poses.h"
#include "fastibl/capture/sensor_noise.h"
#include "fastibl/capture/texel_view.h"
#include "fastibl/core/image.h"
#include "fastibl/core/pose.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/picture.h"
#include "fastibl/scene/pixel_reader.h"

namespace fastibl {

// What is remembered of it from picture to picture.
struct CameraSide {
  explicit CameraSide(const Camera& camera, std::vector<float> vignette = {});
  bool vignettes() const { return !camera.vignetting.empty() || !pixel_vignette.empty(); }
  double vignette(float x, float y) const {
    return pixel_vignette.empty()
               ? camera.vignette({x, y})
               : double(pixel_vignette[std::size_t(int(y) * camera.width + int(x))]);
  }

  Camera camera;
  std::vector<float> pixel_vignette;  // of a WideSide, or empty
  Lens lens;
  PictureBounds bounds;
  SensorNoise noise;
  ByteResponse bytes;
  std::vector<std::optional<glm::dvec3>> probe_rays;
  bool of_wide = false;
  glm::dvec3 looked_from{0};  // metres, marker frame: where lights were last looked for from,
  double looked_at = kNever;  // and when, seconds
};

// What one side shows, and from where.
struct PosedPicture {
  PixelReader pixels() const { return {picture, side.camera.response, side.bytes}; }
  Pose half() const { return poses.at(0.5); }  // of the middle row
  glm::dvec3 eye() const { return half().inverse().translation; }
  bool shows(int x, int y) const { return mask.empty() || *mask.pixel(x, y) != 0; }

  const Picture& picture;
  CameraSide& side;
  RowPoses poses;                      // camera_from_marker
  ImageView<const std::uint8_t> mask;  // as for Capture, and 0 in the margins of a wide one's side
  const PictureMask& hidden;           // as was given to Capture
};

}  // namespace fastibl
