// Lights as a single picture shows them.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/capture/row_poses.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/pixel_reader.h"

namespace fastibl {

// A connected part of a picture that is brighter than a threshold, whole inside of it.
struct BrightSpot {
  glm::dvec3 direction;  // from the camera to its middle by solid angle, unit length, marker frame
  double solid_angle;    // steradians
};

// Parts brighter than `radiance` (mean over RGB), as means over about 80 × 60 blocks. Nothing where
// the exposure cannot tell: white is darker than that, or that is hardly above black.
std::optional<std::vector<BrightSpot>> find_bright_spots(const PixelReader& pixels,
                                                         const Camera& camera, const Lens& lens,
                                                         const RowPoses& camera_from_marker,
                                                         double exposure, double radiance);

}  // namespace fastibl
