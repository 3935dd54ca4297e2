#include "fastibl/scene/shadow_map.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "fastibl/core/simd.h"

namespace fastibl {

bool is_sphere(const glm::vec4& s) {
  return std::isfinite(s.x) && std::isfinite(s.y) && std::isfinite(s.z) && std::isfinite(s.w) &&
         s.w > 0;
}

namespace {

constexpr int kBlock = 256;  // positions that are handled together

// Bilinear, at a position in texels; false outside the image.
bool look_up(const Image<float>& image, float px, float py, glm::vec3& out) {
  const int n = image.width;
  const float limit = float(n) - 0.5f;
  if (n == 0 || !(px > -0.5f && py > -0.5f && px < limit && py < limit)) return false;
  const float last = float(n - 1), x = std::clamp(px, 0.0f, last), y = std::clamp(py, 0.0f, last);
  const int x0 = std::min(int(x), std::max(n - 2, 0)), y0 = std::min(int(y), std::max(n - 2, 0));
  const float fx = x - float(x0), fy = y - float(y0);
  const float *a = image.pixel(x0, y0), *b = a + (n > 1 ? 3 * n : 0);
  const int step = n > 1 ? 3 : 0;
  for (int k = 0; k < 3; ++k) {
    const float left = a[k] + fy * (b[k] - a[k]);
    const float right = a[k + step] + fy * (b[k + step] - a[k + step]);
    out[k] = left + fx * (right - left);
  }
  return true;
}

// Where a block of positions lies in an image.
struct Places {
  std::int32_t offset[kBlock];  // of the first of four texels
  float fx[kBlock], fy[kBlock];
  std::int32_t inside[kBlock];
};

// Plain loop over arrays: it is vectorised. Positions outside are moved inside. Returns how many
// lie inside.
FASTIBL_CLONES
int find_places(const float* px, const float* py, int count, int n, Places& places) {
  const float limit = float(n) - 0.5f, last = float(n - 1);
  int inside = 0;
  for (int i = 0; i < count; ++i) {
    const float x = px[i], y = py[i];
    const bool in = (x > -0.5f) & (y > -0.5f) & (x < limit) & (y < limit);
    // In this order a NaN becomes 0.
    float cx = x > 0 ? x : 0, cy = y > 0 ? y : 0;
    cx = cx < last ? cx : last, cy = cy < last ? cy : last;
    std::int32_t ix = std::int32_t(cx), iy = std::int32_t(cy);
    ix = ix < n - 2 ? ix : n - 2, iy = iy < n - 2 ? iy : n - 2;
    places.offset[i] = 3 * (iy * n + ix);
    places.fx[i] = cx - float(ix), places.fy[i] = cy - float(iy);
    places.inside[i] = in;
    inside += in;
  }
  return inside;
}

// look_up() at places inside: two texels of a row at a time.
FASTIBL_CLONES
void blend(const float* texels, int n, const Places& places, int count, float* out) {
  using Pair [[gnu::vector_size(32), gnu::aligned(4), gnu::may_alias]] = float;
  using Colour [[gnu::vector_size(16), gnu::aligned(4), gnu::may_alias]] = float;
  const std::ptrdiff_t row = 3 * std::ptrdiff_t(n);
  // Eight floats are read where six are needed, so the last of an image are worked out one by one.
  const std::ptrdiff_t safe = row * n - row - 8;
  for (int i = 0; i < count; ++i, out += 3) {
    const std::ptrdiff_t at = places.offset[i];
    const float fx = places.fx[i], fy = places.fy[i];
    const float* a = texels + at;
    if (at > safe || i + 1 == count) {
      for (int k = 0; k < 3; ++k) {
        const float left = a[k] + fy * (a[k + row] - a[k]);
        const float right = a[k + 3] + fy * (a[k + 3 + row] - a[k + 3]);
        out[k] = left + fx * (right - left);
      }
      continue;
    }
    const Pair upper = *reinterpret_cast<const Pair*>(a);
    const Pair lower = *reinterpret_cast<const Pair*>(a + row);
    const Pair both = upper + fy * (lower - upper);
    const Colour left = __builtin_shufflevector(both, both, 0, 1, 2, 3);
    const Colour right = __builtin_shufflevector(both, both, 3, 4, 5, 6);
    *reinterpret_cast<Colour*>(out) = left + fx * (right - left);
  }
}

FASTIBL_CLONES
void to_texels(const float* points, int count, float scale, float shift_x, float shift_y, float* x,
               float* y) {
  for (int i = 0; i < count; ++i) {
    x[i] = points[2 * i] * scale + shift_x;
    y[i] = points[2 * i + 1] * scale + shift_y;
  }
}

FASTIBL_CLONES
void to_outer(const float* x, const float* y, int count, float scale, float shift, float* ox,
              float* oy) {
  for (int i = 0; i < count; ++i) ox[i] = x[i] * scale + shift, oy[i] = y[i] * scale + shift;
}

}  // namespace

glm::vec3 ShadowMap::sample(glm::vec2 point) const {
  const float n = float(ratio.width);
  const glm::vec2 p = (point - centre) * (0.5f * n / extent) + 0.5f * n - 0.5f;
  return sample_texels(p.x, p.y);
}

void ShadowMap::sample(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const {
  const float n = float(ratio.width), scale = 0.5f * n / extent;
  const glm::vec2 shift = 0.5f * n - 0.5f - centre * scale;
  float x[kBlock], y[kBlock];
  for (std::size_t first = 0; first < points.size(); first += kBlock) {
    const int count = int(std::min(std::size_t(kBlock), points.size() - first));
    to_texels(&points[first].x, count, scale, shift.x, shift.y, x, y);
    sample_texels(x, y, count, &ratios[first]);
  }
}

void ShadowMap::sample_outer(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const {
  const float n = float(outer.width), scale = 0.5f * n / outer_extent;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const glm::vec2 p = (points[i] - centre) * scale + 0.5f * n - 0.5f;
    if (!look_up(outer, p.x, p.y, ratios[i])) ratios[i] = glm::vec3(1);
  }
}

glm::vec3 ShadowMap::sample_texels(float px, float py) const {
  glm::vec3 out(1);
  if (no_light || look_up(ratio, px, py, out) || outer.empty()) return out;
  const glm::vec2 p = outer_texels(px, py);
  look_up(outer, p.x, p.y, out);
  return out;
}

glm::vec2 ShadowMap::outer_texels(float x, float y) const {
  const float scale = outer_scale();
  return glm::vec2(x, y) * scale + outer_shift(scale);
}

float ShadowMap::outer_scale() const {
  return float(outer.width) * extent / (float(ratio.width) * outer_extent);
}

float ShadowMap::outer_shift(float scale) const {
  return 0.5f * float(outer.width) - 0.5f - (0.5f * float(ratio.width) - 0.5f) * scale;
}

void ShadowMap::sample_texels(const float* x, const float* y, int count, glm::vec3* ratios) const {
  const bool small = ratio.width < 3 || (!outer.empty() && outer.width < 3);
  if (no_light || ratio.empty() || small) {
    for (int i = 0; i < count; ++i) ratios[i] = sample_texels(x[i], y[i]);
    return;
  }
  Places places;
  for (int first = 0; first < count; first += kBlock) {
    const int n = std::min(kBlock, count - first);
    glm::vec3* out = ratios + first;
    const int inside = find_places(x + first, y + first, n, ratio.width, places);
    if (inside > 0) blend(ratio.data.data(), ratio.width, places, n, &out->x);
    if (inside == n) continue;
    Places outer_places;
    glm::vec3 around[kBlock];
    int inside_outer = 0;
    if (!outer.empty()) {
      float ox[kBlock], oy[kBlock];
      const float scale = outer_scale();
      to_outer(x + first, y + first, n, scale, outer_shift(scale), ox, oy);
      inside_outer = find_places(ox, oy, n, outer.width, outer_places);
      if (inside_outer > 0) blend(outer.data.data(), outer.width, outer_places, n, &around->x);
    }
    for (int i = 0; i < n; ++i)
      if (!places.inside[i])
        out[i] = inside_outer > 0 && outer_places.inside[i] ? around[i] : glm::vec3(1);
  }
}

}  // namespace fastibl
