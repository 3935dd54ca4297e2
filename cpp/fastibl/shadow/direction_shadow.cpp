#include "fastibl/shadow/direction_shadow.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kRows = 16;  // of a map, summed together: their differences stay in the L1 cache

using Share [[gnu::vector_size(16), gnu::may_alias]] = std::int32_t;
using Words [[gnu::vector_size(64), gnu::may_alias]] = std::uint64_t;

// Adds a share where the bits of eight rows begin to be set, and takes it off where they end. The
// cost is that of the edges: of an object a few in a row, whatever its size.
FASTIBL_CLONES
void add_edges(const std::uint64_t* words, std::ptrdiff_t column_stride, int columns,
               const glm::ivec4& whole, glm::ivec4* differences, std::ptrdiff_t row_stride) {
  const Share share = *reinterpret_cast<const Share*>(&whole);
  Words carry{};
  for (int c = 0; c < columns; ++c) {
    const Words bits = *reinterpret_cast<const Words*>(words + c * column_stride);
    const Words changes = bits ^ (bits << 1 | carry);
    std::uint64_t any = 0;
    for (int r = 0; r < 8; ++r) any |= changes[r];
    if (any != 0) {
      for (int r = 0; r < 8; ++r) {
        Share step = carry[r] ? -share : share;
        auto* row = reinterpret_cast<Share*>(differences + r * row_stride + 64 * c);
        for (std::uint64_t left = changes[r]; left != 0; left &= left - 1) {
          row[std::countr_zero(left)] += step;
          step = -step;
        }
      }
    }
    carry = bits >> 63;
  }
}

// Sums the differences of a row up to what is lost there.
FASTIBL_CLONES
void sum_row(const glm::ivec4* differences, int size, float* ratio) {
  constexpr float kScale = 1.0f / kWholeShare;
  Share lost{};
  for (int x = 0; x < size; ++x) {
    lost += reinterpret_cast<const Share*>(differences)[x];
    for (int c = 0; c < 3; ++c) ratio[3 * x + c] = 1 - float(lost[c]) * kScale;
  }
}

void sum_rows(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares, int begin,
              int end, Image<float>& ratio) {
  const int size = ratio.width, columns = (size + 63) / 64;
  const std::ptrdiff_t row_stride = 64 * columns;
  std::vector<glm::ivec4> differences(std::size_t(row_stride) * kRows, glm::ivec4(0));
  for (std::size_t k = 0; k < bits.size(); ++k) {
    const PlaneBits& b = bits[k];
    for (int y = begin; y < end; y += 8)
      add_edges(b.column(0) + y, b.padded_rows(), columns, shares[k],
                differences.data() + (y - begin) * row_stride, row_stride);
  }
  for (int y = begin; y < end; ++y)
    sum_row(differences.data() + (y - begin) * row_stride, size, ratio.row(y));
}

}  // namespace

Image<float> ratio_of(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares) {
  check(!bits.empty() && bits.size() == shares.size(), "there must be as many shares as bits");
  const int size = bits[0].size();
  for (const PlaneBits& b : bits) check(b.size() == size, "the bits must be of one size");
  Image<float> ratio(size, size, 3);
  parallel_for(size, kRows, [&](int begin, int end) { sum_rows(bits, shares, begin, end, ratio); });
  return ratio;
}

}  // namespace fastibl
