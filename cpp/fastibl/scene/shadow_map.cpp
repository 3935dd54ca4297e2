#include "fastibl/scene/shadow_map.h"

#include <algorithm>
#include <cmath>

namespace fastibl {

glm::vec3 ShadowMap::sample(glm::vec2 point) const {
  const int n = ratio.width;
  if (n == 0 || no_light) return glm::vec3(1);
  const glm::vec2 p = (point - centre) * (0.5f * float(n) / extent) + 0.5f * float(n) - 0.5f;
  if (!(p.x > -0.5f && p.y > -0.5f && p.x < float(n) - 0.5f && p.y < float(n) - 0.5f))
    return glm::vec3(1);
  const int x = int(p.x + 1) - 1, y = int(p.y + 1) - 1;
  const float fx = p.x - float(x), fy = p.y - float(y);
  const int x0 = std::max(x, 0), x1 = std::min(x + 1, n - 1), y0 = std::max(y, 0),
            y1 = std::min(y + 1, n - 1);
  const float *a = ratio.pixel(x0, y0), *b = ratio.pixel(x1, y0), *c = ratio.pixel(x0, y1),
              *d = ratio.pixel(x1, y1);
  glm::vec3 out;
  for (int k = 0; k < 3; ++k) {
    const float upper = a[k] + fx * (b[k] - a[k]), lower = c[k] + fx * (d[k] - c[k]);
    out[k] = upper + fy * (lower - upper);
  }
  return out;
}

}  // namespace fastibl
