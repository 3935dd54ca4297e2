#include "fastibl/capture/footprint.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr float kClippedShare = 0.01f;  // of a footprint: more makes the sample a lower bound
// A bilinear look-up on a level of pixels as large as c averages over about 1.5 c: level 0 of c = 2
// is for footprints of 2√2 pixels along an edge. Between two levels both are read and blended in
// the middle half of the way: footprints near a level's own are one look-up.
constexpr float kPixelsOfFirst = 8;
constexpr float kBlendBegin = 1.41421356f, kBlendEnd = 2.82842712f;  // of 1 … 4, by area

#if defined(__GNUC__)
using Vector4 [[gnu::vector_size(16), gnu::aligned(4)]] = float;
#else
struct Vector4 {
  float v[4];
  friend Vector4 operator+(Vector4 a, const Vector4& b) {
    for (int c = 0; c < 4; ++c) a.v[c] += b.v[c];
    return a;
  }
  friend Vector4 operator-(Vector4 a, const Vector4& b) {
    for (int c = 0; c < 4; ++c) a.v[c] -= b.v[c];
    return a;
  }
  friend Vector4 operator*(float s, Vector4 a) {
    for (int c = 0; c < 4; ++c) a.v[c] *= s;
    return a;
  }
};
#endif

// Where texels lie on a level: the index of the upper left pixel, and the way to the next ones.
FASTIBL_CLONES void place_on_level(const float* __restrict px, const float* __restrict py,
                                   float scale, int width, int height, int lanes,
                                   int* __restrict index, float* __restrict fx,
                                   float* __restrict fy) {
  const int n = lanes & ~15;
  const float limit_x = float(width - 1), limit_y = float(height - 1);
  for (int i = 0; i < n; ++i) {
    float x = px[i] * scale - 0.5f, y = py[i] * scale - 0.5f;
    x = x > 0 ? (x < limit_x ? x : limit_x) : 0.0f, y = y > 0 ? (y < limit_y ? y : limit_y) : 0.0f;
    const int ix = int(x), iy = int(y);
    fx[i] = x - float(ix), fy[i] = y - float(iy);
    index[i] = iy * (width + 1) + ix;
  }
}

FASTIBL_CLONES float largest(const float* __restrict pixels, const int* __restrict seen,
                             int lanes) {
  const int n = lanes & ~15;
  float most[16] = {};
  for (int i = 0; i < n; i += 16)
    for (int k = 0; k < 16; ++k) {
      const float p = seen[i + k] ? pixels[i + k] : 0.0f;
      most[k] = p > most[k] ? p : most[k];
    }
  for (int k = 1; k < 16; ++k) most[0] = std::max(most[0], most[k]);
  return most[0];
}

inline Vector4 bilinear(const float* pixel, std::ptrdiff_t stride, float fx, float fy) {
  const auto at = [&](std::ptrdiff_t i) -> const Vector4& {
    return *reinterpret_cast<const Vector4*>(pixel + i);
  };
  const Vector4 upper = at(0) + fx * (at(4) - at(0));
  const Vector4 lower = at(stride) + fx * (at(stride + 4) - at(stride));
  return upper + fy * (lower - upper);
}

FASTIBL_CLONES bool split_channels(const float* __restrict rgba, int lanes,
                                   float (*__restrict linear)[kLanes]) {
  const int n = lanes & ~15;
  int any = 0;
  for (int i = 0; i < n; ++i) {
    linear[0][i] = rgba[4 * i], linear[1][i] = rgba[4 * i + 1], linear[2][i] = rgba[4 * i + 2];
    any |= rgba[4 * i + 3] > 0;
  }
  return any;
}

struct Footprint {
  int level;
  float blend;  // towards the next level
};
Footprint footprint_of(float pixels, int levels) {
  float area = pixels / kPixelsOfFirst;
  int level = 0;
  while (area >= 4 && level < levels - 1) area *= 0.25f, ++level;
  if (level == levels - 1) return {level, 0};
  return {level, std::clamp((area - kBlendBegin) / (kBlendEnd - kBlendBegin), 0.0f, 1.0f)};
}

struct Place {
  int x, y;
  float fx, fy;
};
Place place(const FrameLevels::Level& level, int k, float px, float py) {
  const float scale = 1.0f / float(1 << (k + FrameLevels::kFirst));
  const float x = std::clamp(px * scale - 0.5f, 0.0f, float(level.width - 1));
  const float y = std::clamp(py * scale - 0.5f, 0.0f, float(level.height - 1));
  return {int(x), int(y), x - float(int(x)), y - float(int(y))};
}

}  // namespace

int levels_for(float most_pixels) {
  float area = most_pixels / kPixelsOfFirst;
  int levels = 1;
  while (area > kBlendBegin && levels < FrameLevels::kMost) area *= 0.25f, ++levels;
  return levels;
}

void sample_footprints(const FrameLevels& levels, const Sightings& s, int count, Samples& out) {
  const int lanes = lanes_of(count);
  alignas(64) float rgba[4 * kLanes];
  std::memset(rgba, 0, 4 * sizeof(float) * std::size_t(lanes));
  const auto store = [&](int i, const Vector4& v) { std::memcpy(&rgba[4 * i], &v, sizeof v); };
  const bool first_only =
      levels.count() == 1 || largest(s.pixels, s.seen, lanes) <= kPixelsOfFirst * kBlendBegin;
  if (first_only) {
    alignas(64) int index[kLanes];
    alignas(64) float fx[kLanes], fy[kLanes];
    const FrameLevels::Level& level = levels.level(0);
    place_on_level(s.x, s.y, 0.5f, level.width, level.height, lanes, index, fx, fy);
    const std::ptrdiff_t stride = 4 * (std::ptrdiff_t(level.width) + 1);
    for (int i = 0; i < count; ++i)
      if (s.seen[i])
        store(i, bilinear(&level.pixels[4 * std::size_t(index[i])], stride, fx[i], fy[i]));
  } else {
    for (int i = 0; i < count; ++i) {
      if (!s.seen[i]) continue;
      const Footprint f = footprint_of(s.pixels[i], levels.count());
      const auto tap = [&](int k) {
        const FrameLevels::Level& level = levels.level(k);
        const Place p = place(level, k, s.x[i], s.y[i]);
        return bilinear(level.pixel(p.x, p.y), 4 * (std::ptrdiff_t(level.width) + 1), p.fx, p.fy);
      };
      Vector4 value = tap(f.level);
      if (f.blend > 0) value = value + f.blend * (tap(f.level + 1) - value);
      store(i, value);
    }
  }
  out.any_clipped = split_channels(rgba, lanes, out.linear);
  if (!out.any_clipped) return;
  for (auto& channel : out.clipped) std::fill_n(channel, lanes, 0);
  for (int i = 0; i < count; ++i) {
    if (!s.seen[i] || !(rgba[4 * i + 3] > 0)) continue;
    const Footprint f = footprint_of(s.pixels[i], levels.count());
    const auto share = [&](int k) {
      const Place p = place(levels.level(k), k, s.x[i], s.y[i]);
      return levels.clipped_share(k, p.x, p.y, p.fx, p.fy);
    };
    glm::vec3 clipped = share(f.level);
    if (f.blend > 0) clipped += f.blend * (share(f.level + 1) - clipped);
    for (int c = 0; c < 3; ++c) out.clipped[c][i] = clipped[c] > kClippedShare;
  }
}

}  // namespace fastibl
