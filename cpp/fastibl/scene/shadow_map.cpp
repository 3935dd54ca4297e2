#include "fastibl/scene/shadow_map.h"

#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/scene/shadow_look_up.h"
#include "fastibl/scene/shadow_texels.h"

namespace fastibl {

bool is_sphere(const glm::vec4& s) {
  return std::isfinite(s.x) && std::isfinite(s.y) && std::isfinite(s.z) && std::isfinite(s.w) &&
         s.w > 0;
}

void check_room(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) {
  check(points.size() <= ratios.size(), "there must be a result for each point, ", points.size(),
        ", got ", ratios.size());
}

glm::vec3 ShadowMap::sample(glm::vec2 point) const {
  glm::vec3 out(1);
  if (no_light || sample_shadow(fine, {fine.width, fine_centre, fine_extent, range}, point, out) ||
      sample_shadow(ratio, {ratio.width, centre, extent, range}, point, out))
    return out;
  sample_shadow(outer, {outer.width, centre, outer_extent, range}, point, out);
  return out;
}

void ShadowMap::sample(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const {
  check_room(points, ratios);
  // Preparation costs about one look-up per texel; a look-up by itself costs as much as ten.
  if (points.size() > ratio.data.size() / 16) return ShadowLookUp(*this).sample(points, ratios);
  for (std::size_t i = 0; i < points.size(); ++i) ratios[i] = sample(points[i]);
}

void ShadowMap::sample_outer(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const {
  check_room(points, ratios);
  const ShadowPlace place(outer.width, centre, outer_extent);
  for (std::size_t i = 0; i < points.size(); ++i)
    if (!sample_shadow(outer, place, points[i], ratios[i])) ratios[i] = glm::vec3(1);
}

}  // namespace fastibl
