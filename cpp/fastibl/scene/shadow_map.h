// Sphere proxies, and the shadow that they cast on the marker plane.
#pragma once

#include <span>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// xyz centre, w radius; metres. Spheres that are not finite or have a radius ≤ 0 are ignored and
// counted.
using SphereSet = std::vector<glm::vec4>;
bool is_sphere(const glm::vec4& sphere);

// Throws std::invalid_argument where there is no result for each point.
void check_room(std::span<const glm::vec2> points, std::span<glm::vec3> ratios);

// A channel in which the plane has less irradiance counts as unlit: the inverse times a radiance of
// at most 1e9 would overflow.
inline constexpr float kLeastIrradiance = 1e-28f;

// Ratio of the light on the plane z = 0 with and without the object, RGB in [0, 1].
struct ShadowMap {
  Image<float> ratio;  // texel (i, j) is centred at centre + extent · ((i, j) + ½ − n/2) · 2/n; row
                       // 0 is y min
  glm::vec2 centre{0};  // metres, marker frame
  float extent = 0;     // half the edge in metres
  // A coarser map of the plane around it, with the same centre: shadows end by its border. May be
  // empty.
  Image<float> outer;
  float outer_extent = 0;
  // A finer map of where a compact light casts its shadow, within the others; it includes all
  // light. May be empty.
  Image<float> fine;
  glm::vec2 fine_centre{0};
  float fine_extent = 0;
  float range = 1;  // texels hold 0 … range; a power of two
  int ignored_spheres = 0;
  bool no_light = false;  // nothing lights the plane: the ratio is 1 everywhere

  float reach() const { return outer.empty() ? extent : outer_extent; }  // outside the ratio is 1

  // Bilinear, within 2e-5 of a range of up to 32, in the finest map that contains the point; 1 for NaN.
  glm::vec3 sample(glm::vec2 point) const;
  // The same at many points; for parts of one picture see ShadowLookUp.
  void sample(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const;
  // Samples `outer`, whatever the finer map has there.
  void sample_outer(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const;
  bool operator==(const ShadowMap&) const = default;
};

}  // namespace fastibl
