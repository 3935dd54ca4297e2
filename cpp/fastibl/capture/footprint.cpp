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

// Level of each footprint, in between where two are blended.
FASTIBL_CLONES void choose_levels(const float* __restrict pixels, const int* __restrict seen,
                                  int lanes, float last, float* __restrict chosen,
                                  float* __restrict range) {
  const int n = lanes & ~15;
  float least[16], most[16];
  for (int k = 0; k < 16; ++k) least[k] = last, most[k] = 0;
  for (int i = 0; i < n; i += 16)
    for (int k = 0; k < 16; ++k) {
      float area = pixels[i + k] * (1 / kPixelsOfFirst), level = 0;
      for (int step = 1; step < FrameLevels::kMost; ++step) {
        const float up = area >= 4 ? 1.0f : 0.0f;
        level += up;
        area *= up > 0 ? 0.25f : 1.0f;
      }
      const float way = (area - kBlendBegin) * (1 / (kBlendEnd - kBlendBegin));
      level += way > 0 ? (way < 1 ? way : 1.0f) : 0.0f;
      level = level < last ? level : last;
      chosen[i + k] = level;
      least[k] = seen[i + k] && level < least[k] ? level : least[k];
      most[k] = seen[i + k] && level > most[k] ? level : most[k];
    }
  for (int k = 1; k < 16; ++k) {
    least[0] = least[k] < least[0] ? least[k] : least[0];
    most[0] = most[k] > most[0] ? most[k] : most[0];
  }
  range[0] = least[0], range[1] = most[0];
}

// How much each footprint takes of one level.
FASTIBL_CLONES void weigh_level(const float* __restrict chosen, const int* __restrict seen,
                                int lanes, float level, float* __restrict weights) {
  const int n = lanes & ~15;
  for (int i = 0; i < n; ++i) {
    const float weight = 1 - std::fabs(chosen[i] - level);
    weights[i] = seen[i] && weight > 0 ? weight : 0.0f;
  }
}

FASTIBL_INLINE Float4 bilinear(const float* pixel, std::ptrdiff_t stride, float fx, float fy) {
  const auto at = [&](std::ptrdiff_t i) -> const Float4& {
    return *reinterpret_cast<const Float4*>(pixel + i);
  };
  const Float4 upper = at(0) + fx * (at(4) - at(0));
  const Float4 lower = at(stride) + fx * (at(stride + 4) - at(stride));
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

// Adds each footprint's share of clipped pixels by channel, where it has any.
FASTIBL_CLONES void add_clipped(const float* __restrict pixels,
                                const std::uint32_t* __restrict clipped, int stride,
                                const float* __restrict rgba, const float* __restrict weights,
                                const int* __restrict index, const float* __restrict fx,
                                const float* __restrict fy, int lanes, float unit,
                                float (*__restrict share)[kLanes]) {
  constexpr int kTogether = 16;
  constexpr std::uint32_t mask = (1u << kCountBits) - 1;
  const int n = lanes & ~(kTogether - 1);
  for (int first = 0; first < n; first += kTogether) {
    float any = 0;
    for (int i = first; i < first + kTogether; ++i) any += rgba[4 * i + 3];
    if (!(any > 0)) continue;
    alignas(64) std::uint32_t packed[4][kTogether];
    for (int i = 0; i < kTogether; ++i) {
      const int a = index[first + i], c = a + stride;
      packed[0][i] = pixels[4 * a + 3] > 0 ? clipped[a] : 0;
      packed[1][i] = pixels[4 * a + 7] > 0 ? clipped[a + 1] : 0;
      packed[2][i] = pixels[4 * c + 3] > 0 ? clipped[c] : 0;
      packed[3][i] = pixels[4 * c + 7] > 0 ? clipped[c + 1] : 0;
    }
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < kTogether; ++i) {
        const float x = fx[first + i], y = fy[first + i];
        const auto count = [&](int corner) {
          return float(int(packed[corner][i] >> c * kCountBits & mask));
        };
        const float upper = count(0) + x * (count(1) - count(0));
        const float lower = count(2) + x * (count(3) - count(2));
        share[c][first + i] += weights[first + i] * unit * (upper + y * (lower - upper));
      }
  }
}

FASTIBL_CLONES void split_clipped(const float (*__restrict share)[kLanes], int lanes,
                                  int (*__restrict clipped)[kLanes]) {
  const int n = lanes & ~15;
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < n; ++i) clipped[c][i] = share[c][i] > kClippedShare;
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
  alignas(64) float chosen[kLanes], weights[kLanes], fx[kLanes], fy[kLanes];
  alignas(64) int index[kLanes];
  float range[2];
  choose_levels(s.pixels, s.seen, lanes, float(levels.count() - 1), chosen, range);
  const auto each_level = [&](auto&& body) {
    for (int k = int(range[0]); float(k) < range[1] + 1; ++k) {
      const FrameLevels::Level& level = levels.level(k);
      place_on_level(s.x, s.y, 1.0f / float(1 << (k + FrameLevels::kFirst)), level.width,
                     level.height, lanes, index, fx, fy);
      weigh_level(chosen, s.seen, lanes, float(k), weights);
      body(k, level);
    }
  };
  each_level([&](int k, const FrameLevels::Level& level) {
    const std::ptrdiff_t stride = 4 * (std::ptrdiff_t(level.width) + 1);
    if (float(k) == range[0] && range[0] == range[1]) {  // most groups
      for (int i = 0; i < count; ++i)
        if (s.seen[i]) {
          const Float4 value =
              bilinear(&level.pixels[4 * std::size_t(index[i])], stride, fx[i], fy[i]);
          std::memcpy(&rgba[4 * i], &value, sizeof value);
        }
      return;
    }
    for (int i = 0; i < count; ++i) {
      if (!(weights[i] > 0)) continue;
      Float4 sum;
      std::memcpy(&sum, &rgba[4 * i], sizeof sum);
      sum = sum +
            weights[i] * bilinear(&level.pixels[4 * std::size_t(index[i])], stride, fx[i], fy[i]);
      std::memcpy(&rgba[4 * i], &sum, sizeof sum);
    }
  });
  out.any_clipped = split_channels(rgba, lanes, out.linear);
  if (!out.any_clipped) return;
  alignas(64) float share[3][kLanes];
  for (auto& channel : share) std::fill_n(channel, lanes, 0.0f);
  const auto add = [&](int k, const FrameLevels::Level& level) {
    add_clipped(level.pixels.data(), level.clipped.data(), level.width + 1, rgba, weights, index,
                fx, fy, lanes, 1.0f / float(4 << 2 * k), share);
  };
  if (range[0] == range[1] && range[0] == std::floor(range[0]))
    add(int(range[0]), levels.level(int(range[0])));  // places and weights are still those
  else
    each_level(add);
  split_clipped(share, lanes, out.clipped);
}

}  // namespace fastibl
