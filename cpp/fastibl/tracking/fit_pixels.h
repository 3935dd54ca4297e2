// Fits the last hundredths of a pixel: compares the light that a pose predicts for every pixel at
// the tags' edges with the light that it has. Uses corners, narrow modules and the low noise of
// black, which single edges leave aside.
#pragma once

#include <optional>
#include <span>

#include "fastibl/scene/camera.h"
#include "fastibl/tracking/light_reader.h"
#include "fastibl/tracking/projected_tags.h"

namespace fastibl {

struct PixelFit {
  std::array<double, 6> motion{};       // (w, d) as Tracked::covariance, from the pose of the tags
  std::array<double, 36> covariance{};  // of `motion`, from the pixels' own scatter
  double blur = 0;         // px: standard deviation of the blur, including that by pixels
  std::size_t pixels = 0;  // pixels looked at
};

// tags: projected by `pose`, from which the picture may differ by a tenth of a pixel. Looks at
// about `most` pixels along the black side of edges, where slope²/variance is largest, and makes
// two Gauss–Newton steps with them. Each tag has its own levels of black and white; one blur serves
// all. Tags that fit badly are left out, and so are single pixels that do (Tukey). Nothing where
// modules are too narrow for their blur.
std::optional<PixelFit> fit_pixels(const LightReader& light, const BoardPattern& pattern,
                                   std::span<const ProjectedTag> tags, const Lens& lens,
                                   const Pose& pose, double blur, std::size_t most);

}  // namespace fastibl
