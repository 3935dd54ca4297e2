// Lights as a single picture shows them.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/capture/picture_mask.h"
#include "fastibl/capture/row_poses.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/pixel_reader.h"

namespace fastibl {

// A connected part of a picture that is brighter than a threshold, lies wholly inside the picture,
// and does not touch what is hidden.
struct BrightSpot {
  glm::dvec3 direction;  // from the camera to its middle by solid angle, unit length, marker frame
  double solid_angle;    // steradians
};

// Finds parts brighter than `radiance` (mean over RGB), in means over about 80 × 60 blocks.
// std::nullopt where the exposure cannot tell: white is darker than `radiance`, or `radiance` is
// hardly above black.
std::optional<std::vector<BrightSpot>> find_bright_spots(const PixelReader& pixels,
                                                         const Camera& camera, const Lens& lens,
                                                         const RowPoses& camera_from_marker,
                                                         double exposure, double radiance,
                                                         const PictureMask& hidden);

}  // namespace fastibl
