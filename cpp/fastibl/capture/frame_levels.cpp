#include "fastibl/capture/frame_levels.h"

#include <algorithm>
#include <array>
#include <limits>

#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// Rows of level 0 that are made at a time, along with what is made of them: whole rows of every
// level.
constexpr int kStrip = 32;
static_assert(kStrip % (1 << (FrameLevels::kMost - 1)) == 0);

// Means of 2 × 2 pixels of four floats. False if the fourth is 0 everywhere.
FASTIBL_CLONES bool halve_row(const float* a, const float* b, int count, float* out) {
  Float4 most = {};
  for (int x = 0; x < count; ++x, a += 8, b += 8, out += 4) {
    const Float8 &upper = floats_at<Float8>(a), &lower = floats_at<Float8>(b);
    const Float4 left = __builtin_shufflevector(upper, upper, 0, 1, 2, 3);
    const Float4 right = __builtin_shufflevector(upper, upper, 4, 5, 6, 7);
    const Float4 left_below = __builtin_shufflevector(lower, lower, 0, 1, 2, 3);
    const Float4 right_below = __builtin_shufflevector(lower, lower, 4, 5, 6, 7);
    const Float4 mean = 0.25f * ((left + right) + (left_below + right_below));
    *reinterpret_cast<Float4*>(out) = mean;
    most += mean;
  }
  return most[3] > 0;
}

std::uint32_t packed(const std::array<std::uint32_t, 3>& counts) {
  return std::min(counts[0], 1023u) | std::min(counts[1], 1023u) << 10 |
         std::min(counts[2], 1023u) << 20;
}
std::uint32_t unpacked(std::uint32_t counts, int channel) { return counts >> 10 * channel & 1023u; }

FASTIBL_CLONES void add_counts(const std::uint32_t* __restrict a, const std::uint32_t* __restrict b,
                               int count, std::uint32_t* __restrict out) {
  for (int x = 0; x < count; ++x) out[x] = (a[2 * x] + a[2 * x + 1]) + (b[2 * x] + b[2 * x + 1]);
}

// For the last level, whose numbers would need one more bit.
std::uint32_t saturated_sum(const std::array<std::uint32_t, 4>& counts) {
  std::array<std::uint32_t, 3> sum{};
  for (const std::uint32_t count : counts)
    for (int c = 0; c < 3; ++c) sum[std::size_t(c)] += unpacked(count, c);
  return packed(sum);
}

void repeat_last_column(FrameLevels::Level& level, int y) {
  const std::size_t last = level.index(level.width - 1, y);
  std::copy_n(&level.pixels[4 * last], 4, &level.pixels[4 * last + 4]);
  level.clipped[last + 1] = level.clipped[last];
}

void repeat_last_row(FrameLevels::Level& level) {
  const std::size_t from = level.index(0, level.height - 1), to = level.index(0, level.height);
  const std::size_t count = std::size_t(level.width + 1);
  std::copy_n(&level.pixels[4 * from], 4 * count, &level.pixels[4 * to]);
  std::copy_n(&level.clipped[from], count, &level.clipped[to]);
}

}  // namespace

void FrameLevels::resize(int k, int width, int height) {
  if (int(levels_.size()) <= k) levels_.resize(std::size_t(k) + 1);
  Level& level = levels_[std::size_t(k)];
  if (level.width == width && level.height == height) return;
  level.width = width, level.height = height;
  level.pixels.assign(4 * std::size_t(width + 1) * std::size_t(height + 1), 0.0f);
  level.clipped.assign(std::size_t(width + 1) * std::size_t(height + 1), 0);
}

void FrameLevels::make(const Picture& picture, const Response& response, int levels) {
  resize(0, (picture.width + 1) / 2, (picture.height + 1) / 2);
  count_ = 1;
  while (count_ < std::min(levels, kMost)) {
    const Level& last = level(count_ - 1);
    if (std::min(last.width, last.height) <= 1) break;
    resize(count_, (last.width + 1) / 2, (last.height + 1) / 2);
    ++count_;
  }
  make_first(picture, response);
}

// Makes the rows of coarser levels while the rows that they are made of are at hand.
void FrameLevels::made_row(int k, int y) {
  Level& level = levels_[std::size_t(k)];
  repeat_last_column(level, y);
  const bool last = y == level.height - 1;
  if (last) repeat_last_row(level);
  if (k + 1 == count_ || !(last || y % 2 == 1)) return;
  halve(k + 1, y / 2);
  made_row(k + 1, y / 2);
}

void FrameLevels::make_first(const Picture& picture, const Response& response) {
  const bool bytes = picture.type == PixelType::uint8;
  Image<float> linear;
  if (!bytes) {
    linear = linear_from(picture, response);
  } else if (!table_ || !(table_response_ == response)) {
    table_.emplace(response);
    table_response_ = response;
  }
  // Float pictures are linear and have no white point, so nothing in them is clipped.
  const float limit = picture.type == PixelType::float32
                          ? std::numeric_limits<float>::infinity()
                          : response.decode(float(response.clipped_code()) / 255.0f);
  parallel_for(levels_[0].height, kStrip, [&](int begin, int end) {
    std::vector<std::uint32_t> sums(bytes ? 4 * std::size_t(levels_[0].width) : 0);
    for (int y = begin; y < end; ++y) {
      if (bytes)
        decode_row(picture, y, sums.data());
      else
        take_row(linear, y, limit);
      made_row(0, y);
    }
  });
}

void FrameLevels::decode_row(const Picture& picture, int y, std::uint32_t* sums) {
  Level& level = levels_[0];
  const int pairs = picture.width / 2;
  const std::uint8_t* a = picture.row(2 * y);
  const std::uint8_t* b = picture.row(std::min(2 * y + 1, picture.height - 1));
  float* out = level.pixel(0, y);
  std::uint32_t* clipped = &level.clipped[level.index(0, y)];
  decode_pairs(*table_, a, b, pairs, sums, out, clipped);
  if (pairs == level.width) return;
  // The last column of an odd width stands for two.
  std::uint8_t last[2][6];
  for (int c = 0; c < 6; ++c) last[0][c] = a[6 * pairs + c % 3], last[1][c] = b[6 * pairs + c % 3];
  decode_pairs(*table_, last[0], last[1], 1, sums, out + 4 * pairs, clipped + pairs);
}

void FrameLevels::take_row(const Image<float>& linear, int y, float limit) {
  Level& level = levels_[0];
  for (int x = 0; x < level.width; ++x) {
    float* out = level.pixel(x, y);
    std::array<std::uint32_t, 3> counts{};
    for (int c = 0; c < 4; ++c) out[c] = 0;
    for (const int v : {2 * y, std::min(2 * y + 1, linear.height - 1)})
      for (const int u : {2 * x, std::min(2 * x + 1, linear.width - 1)})
        for (int c = 0; c < 3; ++c) {
          const float value = linear.pixel(u, v)[c];
          out[c] += 0.25f * value;
          if (value >= limit) ++counts[std::size_t(c)], out[3] = 1;
        }
    level.clipped[level.index(x, y)] = packed(counts);
  }
}

// Means of 2 × 2; an odd last row or column is repeated.
void FrameLevels::halve(int k, int y) {
  const Level& fine = levels_[std::size_t(k) - 1];
  Level& coarse = levels_[std::size_t(k)];
  // The row and column after an odd last one repeat it.
  float* out = coarse.pixel(0, y);
  const bool any = halve_row(fine.pixel(0, 2 * y), fine.pixel(0, 2 * y + 1), coarse.width, out);
  std::uint32_t* counts = &coarse.clipped[coarse.index(0, y)];
  const std::uint32_t *a = &fine.clipped[fine.index(0, 2 * y)],
                      *b = &fine.clipped[fine.index(0, 2 * y + 1)];
  if (!any)
    std::fill_n(counts, coarse.width, 0u);
  else if (k < kMost - 1)
    add_counts(a, b, coarse.width, counts);
  else
    for (int x = 0; x < coarse.width; ++x)
      counts[x] = saturated_sum({a[2 * x], a[2 * x + 1], b[2 * x], b[2 * x + 1]});
}

}  // namespace fastibl
