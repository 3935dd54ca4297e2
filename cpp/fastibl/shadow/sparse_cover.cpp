#include "fastibl/shadow/sparse_cover.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/wide.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#endif

namespace fastibl {
namespace {

constexpr int kBlock = SparseCover::kBlock, kTexels = kBlock * kBlock;
constexpr int kPlanes = 6;  // of a counter of images

// A byte of 1 for each of four bits.
constexpr auto kSpread = [] {
  std::array<std::uint32_t, 16> table{};
  for (std::uint32_t n = 0; n < 16; ++n)
    for (std::uint32_t k = 0; k < 4; ++k) table[n] |= (n >> k & 1) << (8 * k);
  return table;
}();

#define FASTIBL_KERNEL "fastibl/shadow/cover_kernel.inl"
#include "fastibl/core/kernel.inl"
FASTIBL_PICK(add_block);

}  // namespace

SparseCover::Source SparseCover::source(std::span<const PlaneBits> images) {
  const int count = int(images.size());
  check(count >= 1 && count < 1 << kPlanes, "a source needs 1 to 63 images, got ", count);
  std::array<std::uint8_t, 1 << kPlanes> share{};
  for (int k = 0; k <= count; ++k)
    share[std::size_t(k)] = std::uint8_t((510 * k + count) / (2 * count));
  const int size = images[0].size(), across = blocks_of(size);
  Source out;
  for (int block_row = 0; block_row < across; ++block_row)
    for (int column = 0; column < images[0].columns(); ++column) {
      // Bit p of the number of images that cover a texel is its bit of plane[p].
      std::uint64_t plane[kPlanes][kBlock] = {}, any = 0;
      const int rows = std::min(kBlock, size - kBlock * block_row);
      for (const PlaneBits& image : images)
        for (int j = 0; j < rows; ++j) {
          std::uint64_t carry = image.column(column)[kBlock * block_row + j];
          any |= carry;
          for (int p = 0; carry != 0 && p < kPlanes; ++p) {
            const std::uint64_t both = plane[p][j] & carry;
            plane[p][j] ^= carry;
            carry = both;
          }
        }
      for (int k = 0; k < 16; ++k) {
        if ((any >> (4 * k) & 15) == 0) continue;
        Texels texels;
        for (int j = 0; j < kBlock; ++j) {
          std::uint32_t counts = 0;
          for (int p = 0; p < kPlanes; ++p) counts += kSpread[plane[p][j] >> (4 * k) & 15] << p;
          for (int i = 0; i < kBlock; ++i)
            texels[std::size_t(kBlock * j + i)] = share[counts >> (8 * i) & 63];
        }
        out.blocks.push_back(block_row * across + 16 * column + k);
        out.cover.push_back(texels);
      }
    }
  return out;
}

SparseCover::SparseCover(int size, std::span<const Source> sources)
    : size_(size), sources_(int(sources.size())) {
  check(sources.size() <= std::numeric_limits<std::uint16_t>::max(), "at most 65535 sources, got ",
        sources.size());
  begin_.assign(std::size_t(blocks()) + 1, 0);
  for (const Source& s : sources)
    for (const std::int32_t b : s.blocks) ++begin_[std::size_t(b) + 1];
  for (std::size_t b = 1; b < begin_.size(); ++b) begin_[b] += begin_[b - 1];
  std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
  source_of_.resize(begin_.back()), cover_.resize(begin_.back());
  for (std::size_t s = 0; s < sources.size(); ++s)
    for (std::size_t e = 0; e < sources[s].blocks.size(); ++e) {
      const std::size_t at = next[std::size_t(sources[s].blocks[e])]++;
      source_of_[at] = std::uint16_t(s), cover_[at] = sources[s].cover[e];
    }
}

SparseCover::SparseCover(int size, int sources, std::vector<std::uint32_t> begin,
                         std::vector<std::uint16_t> source_of, std::vector<Texels> cover)
    : size_(size),
      sources_(sources),
      begin_(std::move(begin)),
      source_of_(std::move(source_of)),
      cover_(std::move(cover)) {
  check(size >= 1 && size <= 4096, "size must be 1 to 4096, got ", size);
  check(begin_.size() == std::size_t(blocks()) + 1, "expected the entries of ", blocks(),
        " blocks, got ", begin_.size());
  check(begin_[0] == 0 && std::is_sorted(begin_.begin(), begin_.end()),
        "expected entries of the blocks one after the other");
  check(begin_.back() == source_of_.size() && begin_.back() == cover_.size(), "expected ",
        begin_.back(), " entries, got ", source_of_.size(), " and ", cover_.size());
  for (const std::uint16_t s : source_of_)
    check(s < sources_, "expected a source below ", sources_, ", got ", s);
}

std::size_t SparseCover::bytes() const {
  return begin_.size() * sizeof(std::uint32_t) + source_of_.size() * sizeof(std::uint16_t) +
         cover_.size() * sizeof(Texels);
}

void SparseCover::add(std::span<const glm::vec4> weights, std::span<float> lost) const {
  if (cover_.empty()) return;
  std::vector<glm::vec4> scaled(weights.begin(), weights.end());
  for (glm::vec4& w : scaled) w *= 1 / 255.0f;
  const int count = blocks();
  parallel_for(count, 128, [&](int first, int last) {
    for (int b = first; b < last; ++b) {
      const std::size_t from = begin_[std::size_t(b)], to = begin_[std::size_t(b) + 1];
      if (from < to)
        add_block(&source_of_[from], cover_[from].data(), to - from, &scaled[0].x,
                  &lost[std::size_t(b) * 3 * kTexels]);
    }
  });
}

}  // namespace fastibl
