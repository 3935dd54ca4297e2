#include "fastibl/scene/shadow_map.h"

#include <algorithm>
#include <cmath>

namespace fastibl {

bool is_sphere(const glm::vec4& s) {
  return std::isfinite(s.x) && std::isfinite(s.y) && std::isfinite(s.z) && std::isfinite(s.w) &&
         s.w > 0;
}

namespace {

// Bilinear, at a position in texels; false outside the image.
bool look_up(const Image<float>& image, float px, float py, glm::vec3& out) {
  const int n = image.width;
  const float limit = float(n) - 0.5f;
  if (n == 0 || !(px > -0.5f && py > -0.5f && px < limit && py < limit)) return false;
  const int x = int(px + 1) - 1, y = int(py + 1) - 1;  // floor
  const float fx = px - float(x), fy = py - float(y);
  const int x0 = std::max(x, 0), x1 = std::min(x + 1, n - 1);
  const float *a = image.row(std::max(y, 0)), *b = image.row(std::min(y + 1, n - 1));
  for (int k = 0; k < 3; ++k) {
    const float upper = a[3 * x0 + k] + fx * (a[3 * x1 + k] - a[3 * x0 + k]);
    const float lower = b[3 * x0 + k] + fx * (b[3 * x1 + k] - b[3 * x0 + k]);
    out[k] = upper + fy * (lower - upper);
  }
  return true;
}

}  // namespace

glm::vec3 ShadowMap::sample(glm::vec2 point) const {
  const float n = float(ratio.width);
  const glm::vec2 p = (point - centre) * (0.5f * n / extent) + 0.5f * n - 0.5f;
  return sample_texels(p.x, p.y);
}

void ShadowMap::sample(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const {
  constexpr std::size_t kBlock = 256;
  const float n = float(ratio.width), scale = 0.5f * n / extent;
  const glm::vec2 shift = 0.5f * n - 0.5f - centre * scale;
  float x[kBlock], y[kBlock];
  for (std::size_t first = 0; first < points.size(); first += kBlock) {
    const std::size_t count = std::min(kBlock, points.size() - first);
    for (std::size_t i = 0; i < count; ++i)
      x[i] = points[first + i].x * scale + shift.x, y[i] = points[first + i].y * scale + shift.y;
    sample_texels(x, y, int(count), &ratios[first]);
  }
}

glm::vec3 ShadowMap::sample_outer(glm::vec2 point) const {
  const float n = float(outer.width);
  const glm::vec2 p = (point - centre) * (0.5f * n / outer_extent) + 0.5f * n - 0.5f;
  glm::vec3 out(1);
  look_up(outer, p.x, p.y, out);
  return out;
}

glm::vec3 ShadowMap::sample_texels(float px, float py) const {
  glm::vec3 out(1);
  if (no_light || look_up(ratio, px, py, out) || outer.empty()) return out;
  const glm::vec2 p = outer_texels(px, py);
  look_up(outer, p.x, p.y, out);
  return out;
}

glm::vec2 ShadowMap::outer_texels(float x, float y) const {
  const float n = float(ratio.width), m = float(outer.width);
  const float scale = m * extent / (n * outer_extent);
  return (glm::vec2(x, y) - (0.5f * n - 0.5f)) * scale + (0.5f * m - 0.5f);
}

void ShadowMap::sample_texels(const float* x, const float* y, int count, glm::vec3* ratios) const {
  for (int i = 0; i < count; ++i) ratios[i] = sample_texels(x[i], y[i]);
}

}  // namespace fastibl
