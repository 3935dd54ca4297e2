#include "fastibl/scene/shadow_look_up.h"

#include <algorithm>
#include <cstring>

#include "fastibl/core/wide.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#ifndef __clang__  // GCC 12 warns of its own header's undefined registers
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#endif

namespace fastibl {
namespace {

constexpr int kBlock = 256;  // points that are handled together

// Where a block of points lies in a level.
struct alignas(64) Places {
  std::int32_t at[kBlock];  // first column of two
  std::int32_t left[kBlock],
      right[kBlock];                  // weights of their upper and lower texels, 16 bits each
  std::uint16_t inside[kBlock / 16];  // a bit per point
};

#define FASTIBL_KERNEL "fastibl/scene/shadow_look_up_kernel.inl"
#define FASTIBL_KERNEL_AVX512
#include "fastibl/core/kernel.inl"
FASTIBL_PICK(encode);
FASTIBL_PICK(interleave);
FASTIBL_PICK_AVX512(find_texels);
FASTIBL_PICK_AVX512(blend);

ShadowLookUp::Level level_of(const Image<float>& image, glm::vec2 centre, float extent,
                             float range) {
  const int n = image.width;
  ShadowLookUp::Level level{{n, centre, extent, range}, {}};
  level.columns.resize(std::size_t(n) * std::size_t(n + 1));
  // Two rows in turn, each with a code beyond its end.
  std::vector<std::int16_t> rows(2 * std::size_t(3 * n + 1));
  const auto row = [&](int y) { return rows.data() + std::size_t(y % 2) * std::size_t(3 * n + 1); };
  encode(image.row(0), 3 * n, range, row(0));
  for (int y = 0; y < n; ++y) {
    if (y + 1 < n) encode(image.row(y + 1), 3 * n, range, row(y + 1));
    ShadowLookUp::Column* out = &level.columns[std::size_t(y) * std::size_t(n + 1)];
    interleave(row(y), row(y + 1 < n ? y + 1 : y), n, out);
    out[n] = out[n - 1];
  }
  return level;
}

// Ratios of a block's points, each from the first level that has it; `out` has room for four floats
// more.
void sample_block(std::span<const ShadowLookUp::Level> levels, const float* points, int count,
                  float* out) {
  Places places;
  std::uint16_t left[kBlock / 16];  // points that no level had yet
  bool first = true;
  for (const ShadowLookUp::Level& level : levels) {
    const int found = find_texels(level.place, points, count, places);
    if (first) {
      if (found > 0) blend(level.columns.data(), places, count, level.place.range, out);
      if (found == count) return;
      for (int k = 0; k < count / 16; ++k) left[k] = std::uint16_t(~places.inside[k]);
      first = false;
      continue;
    }
    if (found == 0) continue;
    float here[3 * kBlock + 4];
    blend(level.columns.data(), places, count, level.place.range, here);
    for (int i = 0; i < count; ++i)
      if ((left[i / 16] & places.inside[i / 16]) >> (i % 16) & 1)
        for (int c = 0; c < 3; ++c) out[3 * i + c] = here[3 * i + c];
    for (int k = 0; k < count / 16; ++k) left[k] &= std::uint16_t(~places.inside[k]);
  }
  for (int i = 0; i < count; ++i)
    if (first || (left[i / 16] >> (i % 16) & 1))
      for (int c = 0; c < 3; ++c) out[3 * i + c] = 1;
}

}  // namespace

ShadowLookUp::ShadowLookUp(const ShadowMap& map) : centre_(map.centre), reach_(map.reach()) {
  if (map.no_light || map.ratio.empty()) return;
  if (map.range > kMostCoded) {
    uncoded_ = map;
    return;
  }
  if (!map.fine.empty())
    levels_.push_back(level_of(map.fine, map.fine_centre, map.fine_extent, map.range));
  levels_.push_back(level_of(map.ratio, map.centre, map.extent, map.range));
  if (!map.outer.empty())
    levels_.push_back(level_of(map.outer, map.centre, map.outer_extent, map.range));
}

void ShadowLookUp::sample(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const {
  check_room(points, ratios);
  const std::size_t count = points.size();
  if (uncoded_) {
    for (std::size_t k = 0; k < count; ++k) ratios[k] = uncoded_->sample(points[k]);
    return;
  }
  std::size_t i = 0;
  for (; i + kBlock + 2 <= count; i += kBlock)
    sample_block(levels_, &points[i].x, kBlock, &ratios[i].x);
  // The rest is copied, so that nothing beyond the ends is touched.
  for (; i < count; i += kBlock) {
    const std::size_t n = std::min(std::size_t(kBlock), count - i);
    float some[2 * kBlock], out[3 * kBlock + 4];
    const std::size_t padded = (n + 15) / 16 * 16;
    std::memcpy(some, &points[i].x, 2 * n * sizeof(float));
    std::fill(some + 2 * n, some + 2 * padded, 0.0f);
    sample_block(levels_, some, int(padded), out);
    std::memcpy(&ratios[i].x, out, 3 * n * sizeof(float));
  }
}

}  // namespace fastibl
