#include "fastibl/shadow/shadow_options.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

constexpr float kDefaultExtent = 3.0f;  // × the half width of the spheres
constexpr float kFarthest = 1e30f;      // metres; keeps centre and extent finite for any sphere

}  // namespace

void check_options(const ShadowOptions& options) {
  const int n = options.resolution;
  check(n == 0 || (n >= 2 && n <= 8192),
        "the shadow map's resolution must be 2 to 8192, or 0 for the method's own, got ", n);
  check(std::isfinite(options.extent) && options.extent >= 0,
        "the shadow map's extent must be finite and at least 0 (0: from the spheres), got ",
        options.extent);
  if (options.centre)
    check(std::isfinite(options.centre->x) && std::isfinite(options.centre->y),
          "the shadow map's centre must be finite");
}

void place_map(const SphereSet& spheres, const ShadowOptions& options, ShadowMap& map) {
  glm::vec3 lower(std::numeric_limits<float>::max()), upper(-lower);
  for (const glm::vec4& s : spheres)
    if (is_sphere(s) && s.z + s.w > 0)
      for (int i = 0; i < 3; ++i)
        lower[i] = std::min(lower[i], std::max(s[i] - s.w, -kFarthest)),
        upper[i] = std::max(upper[i], std::min(s[i] + s.w, kFarthest));
  const bool any = lower.x <= upper.x;
  map.centre = options.centre.value_or(any ? 0.5f * glm::vec2(lower) + 0.5f * glm::vec2(upper)
                                           : glm::vec2(0));
  map.extent = options.extent;
  if (map.extent == 0)
    map.extent = any ? kDefaultExtent * 0.5f *
                           std::max({upper.x - lower.x, upper.y - lower.y, std::max(upper.z, 0.0f)})
                     : 1.0f;
}

}  // namespace fastibl
