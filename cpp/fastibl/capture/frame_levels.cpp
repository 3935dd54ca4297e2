#include "fastibl/capture/frame_levels.h"

#include <algorithm>
#include <array>
#include <limits>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// Means of 2 × 2 pixels of four floats.
FASTIBL_CLONES void halve_row(const float* a, const float* b, int count, float* out) {
  for (int x = 0; x < count; ++x, a += 8, b += 8, out += 4)
    for (int c = 0; c < 4; ++c) out[c] = 0.25f * ((a[c] + a[c + 4]) + (b[c] + b[c + 4]));
}

std::uint32_t packed(const std::array<std::uint32_t, 3>& counts) {
  return std::min(counts[0], 1023u) | std::min(counts[1], 1023u) << 10 |
         std::min(counts[2], 1023u) << 20;
}
std::uint32_t unpacked(std::uint32_t counts, int channel) { return counts >> 10 * channel & 1023u; }

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
  make_first(picture, response);
  count_ = 1;
  while (count_ < std::min(levels, kMost)) {
    const Level& last = level(count_ - 1);
    if (std::min(last.width, last.height) <= 1) break;
    resize(count_, (last.width + 1) / 2, (last.height + 1) / 2);
    halve(count_);
    ++count_;
  }
}

void FrameLevels::make_first(const Picture& picture, const Response& response) {
  Level& level = levels_[0];
  if (picture.type == PixelType::uint8) {
    if (!table_ || !(table_response_ == response)) table_.emplace(response);
    table_response_ = response;
    sums_.resize(3 * std::size_t(level.width));
    const int pairs = picture.width / 2;
    for (int y = 0; y < level.height; ++y) {
      const std::uint8_t* a = picture.row(2 * y);
      const std::uint8_t* b = picture.row(std::min(2 * y + 1, picture.height - 1));
      float* out = level.pixel(0, y);
      bool clean = decode_pairs(*table_, a, b, pairs, sums_.data(), out);
      // The last column of an odd width stands for two.
      std::uint8_t last[2][6] = {};
      if (pairs < level.width) {
        for (int c = 0; c < 6; ++c)
          last[0][c] = a[6 * pairs + c % 3], last[1][c] = b[6 * pairs + c % 3];
        std::uint32_t* scratch = &sums_[3 * std::size_t(pairs)];
        if (!decode_pairs(*table_, last[0], last[1], 1, scratch, out + 4 * pairs)) clean = false;
      }
      if (!clean) {
        sum_pairs(*table_, a, b, pairs, sums_.data());
        if (pairs < level.width)
          sum_pairs(*table_, last[0], last[1], 1, &sums_[3 * std::size_t(pairs)]);
        mark_clipped(y);
      }
      repeat_last_column(level, y);
    }
  } else {
    const Image<float> linear = linear_from(picture, response);
    // Float pictures are linear without a white point: nothing in them is clipped.
    const float limit = picture.type == PixelType::float32
                            ? std::numeric_limits<float>::infinity()
                            : response.decode(CodeTable::kClippedCode / 255.0f);
    for (int y = 0; y < level.height; ++y) {
      for (int x = 0; x < level.width; ++x) {
        float* out = level.pixel(x, y);
        std::array<std::uint32_t, 3> counts{};
        for (int c = 0; c < 4; ++c) out[c] = 0;
        for (const int v : {2 * y, std::min(2 * y + 1, picture.height - 1)})
          for (const int u : {2 * x, std::min(2 * x + 1, picture.width - 1)})
            for (int c = 0; c < 3; ++c) {
              const float value = linear.pixel(u, v)[c];
              out[c] += 0.25f * value;
              if (value >= limit) ++counts[std::size_t(c)], out[3] = 1;
            }
        level.clipped[level.index(x, y)] = packed(counts);
      }
      repeat_last_column(level, y);
    }
  }
  repeat_last_row(level);
}

// Counts of a row of the first level, from its sums.
void FrameLevels::mark_clipped(int y) {
  Level& level = levels_[0];
  float* out = level.pixel(0, y);
  for (int x = 0; x < level.width; ++x) {
    const std::uint32_t* s = &sums_[3 * std::size_t(x)];
    const std::uint32_t counts =
        packed({CodeTable::count(s[0]), CodeTable::count(s[1]), CodeTable::count(s[2])});
    level.clipped[level.index(x, y)] = counts;
    if (counts) out[4 * x + 3] = 1;
  }
}

// Means of 2 × 2; an odd last row or column is repeated.
void FrameLevels::halve(int k) {
  const Level& fine = levels_[std::size_t(k) - 1];
  Level& coarse = levels_[std::size_t(k)];
  for (int y = 0; y < coarse.height; ++y) {
    // The row and column after an odd last one repeat it.
    const float *a = fine.pixel(0, 2 * y), *b = fine.pixel(0, 2 * y + 1);
    float* out = coarse.pixel(0, y);
    halve_row(a, b, coarse.width, out);
    for (int x = 0; x < coarse.width; ++x) {
      if (!(out[4 * x + 3] > 0)) continue;
      std::array<std::uint32_t, 3> counts{};
      for (const int v : {2 * y, 2 * y + 1})
        for (const int u : {2 * x, 2 * x + 1})
          if (fine.pixel(u, v)[3] > 0)
            for (int c = 0; c < 3; ++c)
              counts[std::size_t(c)] += unpacked(fine.clipped[fine.index(u, v)], c);
      coarse.clipped[coarse.index(x, y)] = packed(counts);
    }
    repeat_last_column(coarse, y);
  }
  repeat_last_row(coarse);
}

glm::vec3 FrameLevels::clipped_share(int k, int x, int y, float fx, float fy) const {
  const Level& l = level(k);
  const float weights[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
  glm::vec3 share(0);
  for (int i = 0; i < 4; ++i) {
    const int u = x + (i & 1), v = y + (i >> 1);
    if (l.pixel(u, v)[3] > 0)
      for (int c = 0; c < 3; ++c)
        share[c] += weights[i] * float(unpacked(l.clipped[l.index(u, v)], c));
  }
  return share / float(4 << 2 * k);
}

}  // namespace fastibl
