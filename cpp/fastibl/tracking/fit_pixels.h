// The last hundredths of a pixel: the light that a pose lets every pixel at the tags' edges have,
// against the light it has. Uses corners, narrow modules and the low noise of black, which single
// edges leave aside.
#pragma once

#include <optional>
#include <span>

#include "fastibl/scene/camera.h"
#include "fastibl/tracking/light_reader.h"
#include "fastibl/tracking/projected_tags.h"

namespace fastibl {

struct PixelFit {
  std::array<double, 6> motion{};       // (w, d) as Tracked::covariance, from the pose of the tags
  std::array<double, 36> covariance{};  // of it, by the pixels' own scatter
  double blur = 0;                      // px: standard deviation of the blur, with that of pixels
  std::size_t pixels = 0;               // looked at
};

// tags: projected by `pose`, from which the picture may differ by a tenth of a pixel. Looks at
// about `most` pixels along the black side of edges, where slope²/variance is largest, and makes
// two Gauss–Newton steps with them. The levels of black and white are each tag's own; one blur for
// all. Tags that fit badly and single pixels that do (Tukey) are left out. Nothing where modules
// are too narrow for their blur.
std::optional<PixelFit> fit_pixels(const LightReader& light, const BoardPattern& pattern,
                                   std::span<const ProjectedTag> tags, const Lens& lens,
                                   const Pose& pose, double blur, std::size_t most);

}  // namespace fastibl
