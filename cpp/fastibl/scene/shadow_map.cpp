#include "fastibl/scene/shadow_map.h"

#include <algorithm>
#include <cmath>

namespace fastibl {

bool is_sphere(const glm::vec4& s) {
  return std::isfinite(s.x) && std::isfinite(s.y) && std::isfinite(s.z) && std::isfinite(s.w) &&
         s.w > 0;
}

glm::vec3 ShadowMap::sample(glm::vec2 point) const {
  const float n = float(ratio.width);
  const glm::vec2 p = (point - centre) * (0.5f * n / extent) + 0.5f * n - 0.5f;
  return sample_texels(p.x, p.y);
}

glm::vec3 ShadowMap::sample_texels(float px, float py) const {
  const int n = ratio.width;
  const float limit = float(n) - 0.5f;
  if (n == 0 || no_light || !(px > -0.5f && py > -0.5f && px < limit && py < limit))
    return glm::vec3(1);
  const int x = int(px + 1) - 1, y = int(py + 1) - 1;  // floor
  const float fx = px - float(x), fy = py - float(y);
  const int x0 = std::max(x, 0), x1 = std::min(x + 1, n - 1);
  const float *a = ratio.row(std::max(y, 0)), *b = ratio.row(std::min(y + 1, n - 1));
  glm::vec3 out;
  for (int k = 0; k < 3; ++k) {
    const float upper = a[3 * x0 + k] + fx * (a[3 * x1 + k] - a[3 * x0 + k]);
    const float lower = b[3 * x0 + k] + fx * (b[3 * x1 + k] - b[3 * x0 + k]);
    out[k] = upper + fy * (lower - upper);
  }
  return out;
}

}  // namespace fastibl
