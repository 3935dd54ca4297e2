#include "fastibl/capture/footprint.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// At a lamp's rim: ratio of a group's brightest texel to the mean, or to the darkest, where the
// lamp fills most of the group.
constexpr float kContrast = 2, kWholeContrast = 4;
constexpr float kClippedShare = 0.01f;  // of a footprint: more makes the sample a lower bound
// A bilinear look-up on a level with pixels of size c averages over about 1.5 c. So level 0, which
// has c = 2, is for footprints of 2√2 pixels along an edge. In the middle half of the way between
// two levels both are read and blended; footprints near a level's own size take one look-up.
constexpr float kPixelsOfFirst = 8;
constexpr float kBlendBegin = 1.41421356f, kBlendEnd = 2.82842712f;  // of 1 … 4, by area

// Where texels lie on a level: the index of the upper left pixel, and the share of the way to the
// next ones.
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

// Level of each footprint: fractional where two are blended.
template <typename V>
FASTIBL_INLINE void choose_levels_by(const float* __restrict pixels, const int* __restrict seen,
                                     int lanes, float last, float* __restrict chosen,
                                     float* __restrict range) {
  const V none = {}, one = none + 1.0f, final = none + last;
  V least = final, most = none;
  for (int i = 0; i < lanes; i += kFloatsIn<V>) {
    V area = floats_at<V>(pixels + i) * (1 / kPixelsOfFirst);
    V level = none;
    for (int step = 1; step < FrameLevels::kMost; ++step) {
      level += area >= 4.0f ? one : none;
      area = area >= 4.0f ? area * 0.25f : area;
    }
    const V way = (area - kBlendBegin) * (1 / (kBlendEnd - kBlendBegin));
    const V risen = way > none ? way : none;
    level += risen < one ? risen : one;
    level = level < final ? level : final;
    put_floats(level, chosen + i);
    const auto shown = ints_at<V>(seen + i) != 0;
    const V low = shown ? level : final, high = shown ? level : none;
    least = low < least ? low : least, most = high > most ? high : most;
  }
  range[0] = least[0], range[1] = most[0];
  for (int k = 1; k < kFloatsIn<V>; ++k) {
    range[0] = least[k] < range[0] ? least[k] : range[0];
    range[1] = most[k] > range[1] ? most[k] : range[1];
  }
}
FASTIBL_BY_WIDTH(void choose_levels(const float* pixels, const int* seen, int lanes, float last,
                                    float* chosen, float* range),
                 choose_levels_by<V>(pixels, seen, lanes, last, chosen, range))

// The weight of one level in each footprint.
FASTIBL_CLONES void weigh_level(const float* __restrict chosen, const int* __restrict seen,
                                int lanes, float level, float* __restrict weights) {
  const int n = lanes & ~15;
  for (int i = 0; i < n; ++i) {
    const float weight = 1 - std::fabs(chosen[i] - level);
    weights[i] = seen[i] && weight > 0 ? weight : 0.0f;
  }
}

// upper, lower: two pixels side by side.
FASTIBL_INLINE Float4 bilinear(const Float8& upper, const Float8& lower, float fx, float fy) {
  const Float8 both = upper + fy * (lower - upper);
  const Float4 left = __builtin_shufflevector(both, both, 0, 1, 2, 3);
  const Float4 right = __builtin_shufflevector(both, both, 4, 5, 6, 7);
  return left + fx * (right - left);
}

// Where look-ups lie on a level, and the level's weight in each footprint.
struct LookUps {
  alignas(64) float fx[kTexelLanes], fy[kTexelLanes], weights[kTexelLanes];
  alignas(64) int index[kTexelLanes];
};

// Adds weighted look-ups in rows of pixels that lie `stride` values apart.
FASTIBL_CLONES void add_look_ups(const float* pixels, std::ptrdiff_t stride, const LookUps& at,
                                 int count, float* rgba) {
  for (int i = 0; i < count; ++i) {
    if (!(at.weights[i] > 0)) continue;
    const float* pixel = pixels + 4 * std::ptrdiff_t(at.index[i]);
    Float4& sum = *reinterpret_cast<Float4*>(rgba + 4 * i);
    sum += at.weights[i] * bilinear(*reinterpret_cast<const Float8*>(pixel),
                                    *reinterpret_cast<const Float8*>(pixel + stride), at.fx[i],
                                    at.fy[i]);
  }
}

FASTIBL_CLONES bool split_channels(const float* __restrict rgba, int lanes,
                                   float (*__restrict linear)[kTexelLanes]) {
  const int n = lanes & ~15;
  int any = 0;
  for (int i = 0; i < n; ++i) {
    linear[0][i] = rgba[4 * i], linear[1][i] = rgba[4 * i + 1], linear[2][i] = rgba[4 * i + 2];
    any |= rgba[4 * i + 3] > 0;
  }
  return any;
}

// Adds each footprint's share of clipped pixels by channel, where it has any.
FASTIBL_CLONES void add_clipped(const std::uint32_t* __restrict clipped, int stride,
                                const float* __restrict rgba, const float* __restrict weights,
                                const int* __restrict index, const float* __restrict fx,
                                const float* __restrict fy, int lanes, float unit,
                                float (*__restrict share)[kTexelLanes]) {
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
      packed[0][i] = clipped[a], packed[1][i] = clipped[a + 1];
      packed[2][i] = clipped[c], packed[3][i] = clipped[c + 1];
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

FASTIBL_CLONES void split_clipped(const float (*__restrict share)[kTexelLanes], int lanes,
                                  int (*__restrict clipped)[kTexelLanes]) {
  const int n = lanes & ~15;
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < n; ++i) clipped[c][i] = share[c][i] > kClippedShare;
}

// Whether a group shows the rim of a lamp.
template <typename V>
FASTIBL_INLINE bool shows_light_by(const float (*__restrict linear)[kTexelLanes],
                                   const int* __restrict seen, int lanes, float light) {
  const V none = {}, one = none + 1.0f;
  float sum = 0, count = 0, most = 0, least = 1e30f;
  for (int part = 0; part < 16; part += kFloatsIn<V>) {
    V values = none, counts = none, highest = none, lowest = none + least;
    for (int i = part; i < lanes; i += 16) {
      const auto shown = ints_at<V>(seen + i) != 0;
      const V all =
          floats_at<V>(linear[0] + i) + floats_at<V>(linear[1] + i) + floats_at<V>(linear[2] + i);
      const V value = shown ? all : none;
      values += value, counts += shown ? one : none;
      highest = value > highest ? value : highest;
      const V dark = shown ? all : none + 1e30f;
      lowest = dark < lowest ? dark : lowest;
    }
    add_each(values, sum), add_each(counts, count);
    for (int k = 0; k < kFloatsIn<V>; ++k) {
      most = highest[k] > most ? highest[k] : most;
      least = lowest[k] < least ? lowest[k] : least;
    }
  }
  return most > 3 * light && (most * count > kContrast * sum || most > kWholeContrast * least);
}
FASTIBL_BY_WIDTH(bool shows_light(const float (*linear)[kTexelLanes], const int* seen, int lanes,
                                  float light),
                 shows_light_by<V>(linear, seen, lanes, light))

// A quarter of each footprint, on the picture's axes.
FASTIBL_CLONES void quarter(const Sightings& s, float right, float down, int lanes,
                            Sightings& part) {
  const int n = lanes & ~15;
  for (int i = 0; i < n; ++i) {
    const float edge = std::sqrt(s.pixels[i] > 0 ? s.pixels[i] : 0.0f);
    part.x[i] = s.x[i] + right * edge, part.y[i] = s.y[i] + down * edge;
    part.pixels[i] = 0.5f * s.pixels[i];  // so that look-ups overlap and leave no gap
    part.seen[i] = s.seen[i];
  }
}

void sample_whole(const FrameLevels& levels, const Sightings& s, int count, Samples& out);

// Samples footprints as the mean of four quarters. Those of neighbours then fit together, and what
// lies between the middles of two of them is not lost: the captured energy of a lamp of 6 pixels
// scatters by 4 % instead of 19.
void sample_quarters(const FrameLevels& levels, const Sightings& s, int count, Samples& out) {
  const int lanes = lanes_of(count);
  Samples part, sum{};
  alignas(64) float least[3][kTexelLanes], most[3][kTexelLanes];
  for (int c = 0; c < 3; ++c)
    std::fill_n(least[c], lanes, std::numeric_limits<float>::infinity()),
        std::fill_n(most[c], lanes, 0.0f);
  Sightings of;
  for (const float down : {-0.25f, 0.25f})
    for (const float right : {-0.25f, 0.25f}) {
      quarter(s, right, down, lanes, of);
      sample_whole(levels, of, count, part);
      for (int c = 0; c < 3; ++c)
        for (int i = 0; i < lanes; ++i) {
          const float value = part.linear[c][i];
          sum.linear[c][i] += 0.25f * value;
          least[c][i] = value < least[c][i] ? value : least[c][i];
          most[c][i] = value > most[c][i] ? value : most[c][i];
          if (part.any_clipped) sum.clipped[c][i] |= part.clipped[c][i];
        }
      sum.any_clipped |= part.any_clipped;
    }
  for (int c = 0; c < 3; ++c) {
    std::copy_n(sum.linear[c], lanes, out.linear[c]);
    std::copy_n(sum.clipped[c], lanes, out.clipped[c]);
    for (int i = 0; i < lanes; ++i) out.spread[c][i] = most[c][i] - least[c][i];
  }
  out.any_clipped = sum.any_clipped;
}

}  // namespace

PixelBox footprint_box(float x, float y, float pixels) {
  // The first of the two pixels that a look-up reads along an axis, and how wide they are.
  const auto width = [](float area) {
    int wide = 2;
    for (area /= kPixelsOfFirst; area > kBlendBegin && wide < 1 << FrameLevels::kMost; area /= 4)
      wide *= 2;
    return wide;
  };
  const auto first = [](float at, int wide) {
    return int(std::floor(at / float(wide) - 0.5f)) * wide;
  };
  const float off = 0.25f * std::sqrt(std::max(pixels, 0.0f));  // of quarters
  const int whole = width(pixels), part = width(0.5f * pixels);
  return {std::min(first(x, whole), first(x - off, part)),
          std::min(first(y, whole), first(y - off, part)),
          std::max(first(x, whole) + 2 * whole, first(x + off, part) + 2 * part),
          std::max(first(y, whole) + 2 * whole, first(y + off, part) + 2 * part)};
}

int levels_for(float most_pixels) {
  float area = most_pixels / kPixelsOfFirst;
  int levels = 1;
  while (area > kBlendBegin && levels < FrameLevels::kMost) area *= 0.25f, ++levels;
  return levels;
}

bool sample_footprints(const FrameLevels& levels, const Sightings& s, int count, float light,
                       bool fine, Samples& out) {
  sample_whole(levels, s, count, out);
  const bool rim = shows_light(out.linear, s.seen, lanes_of(count), light);
  out.fine = rim || fine;
  if (out.fine) sample_quarters(levels, s, count, out);
  return rim;
}

namespace {

void sample_whole(const FrameLevels& levels, const Sightings& s, int count, Samples& out) {
  const int lanes = lanes_of(count);
  alignas(64) float rgba[4 * kTexelLanes];
  std::memset(rgba, 0, 4 * sizeof(float) * std::size_t(lanes));
  alignas(64) float chosen[kTexelLanes];
  LookUps at;
  float range[2];
  choose_levels(s.pixels, s.seen, lanes, float(levels.count() - 1), chosen, range);
  const auto each_level = [&](auto&& body) {
    for (int k = int(range[0]); float(k) < range[1] + 1; ++k) {
      const FrameLevels::Level& level = levels.level(k);
      place_on_level(s.x, s.y, 1.0f / float(1 << (k + FrameLevels::kFirst)), level.width,
                     level.height, lanes, at.index, at.fx, at.fy);
      weigh_level(chosen, s.seen, lanes, float(k), at.weights);
      body(k, level);
    }
  };
  each_level([&](int, const FrameLevels::Level& level) {
    const std::ptrdiff_t stride = 4 * (std::ptrdiff_t(level.width) + 1);
    add_look_ups(level.pixels.data(), stride, at, count, rgba);
  });
  out.any_clipped = split_channels(rgba, lanes, out.linear);
  if (!out.any_clipped) return;
  alignas(64) float share[3][kTexelLanes];
  for (auto& channel : share) std::fill_n(channel, lanes, 0.0f);
  const auto add = [&](int k, const FrameLevels::Level& level) {
    add_clipped(level.clipped.data(), level.width + 1, rgba, at.weights, at.index, at.fx, at.fy,
                lanes, 1.0f / float(4 << 2 * k), share);
  };
  if (range[0] == range[1] && range[0] == std::floor(range[0]))
    add(int(range[0]), levels.level(int(range[0])));  // places and weights are still valid
  else
    each_level(add);
  split_clipped(share, lanes, out.clipped);
}

}  // namespace
}  // namespace fastibl
