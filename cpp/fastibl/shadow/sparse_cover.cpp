#include "fastibl/shadow/sparse_cover.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/wide.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#ifndef __clang__  // GCC 12 warns of its own header's undefined registers
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#endif

namespace fastibl {
namespace {

constexpr int kBlock = SparseCover::kBlock, kTexels = kBlock * kBlock;
constexpr int kPlanes = 6;  // of a counter of images
constexpr auto kWhole = [] {
  SparseCover::Texels texels{};
  texels.fill(255);
  return texels;
}();

// A byte of 1 for each of four bits.
constexpr auto kSpread = [] {
  std::array<std::uint32_t, 16> table{};
  for (std::uint32_t n = 0; n < 16; ++n)
    for (std::uint32_t k = 0; k < 4; ++k) table[n] |= (n >> k & 1) << (8 * k);
  return table;
}();

#define FASTIBL_KERNEL "fastibl/shadow/cover_kernel.inl"
#define FASTIBL_KERNEL_AVX512
#include "fastibl/core/kernel.inl"
FASTIBL_PICK_AVX512(add_block);

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
  // The entries of each block, and its runs, are counted before they are stored.
  auto& [begin, source_of, cover, run_begin, runs] = table_;
  begin.assign(std::size_t(blocks()) + 1, 0);
  run_begin = begin;
  constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> run_end(begin.size(), kNone);  // of the last run
  const auto for_each = [&](const auto& add_entry, const auto& add_run, const auto& extend_run) {
    std::fill(run_end.begin(), run_end.end(), kNone);
    for (std::uint32_t s = 0; s < sources.size(); ++s)
      for (std::size_t e = 0; e < sources[s].blocks.size(); ++e) {
        const auto b = std::size_t(sources[s].blocks[e]);
        if (sources[s].cover[e] != kWhole)
          add_entry(b, s, sources[s].cover[e]);
        else if (std::exchange(run_end[b], s + 1) == s)
          extend_run(b);
        else
          add_run(b, s);
      }
  };
  for_each([&](std::size_t b, std::uint32_t, const Texels&) { ++begin[b + 1]; },
           [&](std::size_t b, std::uint32_t) { ++run_begin[b + 1]; }, [](std::size_t) {});
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::partial_sum(run_begin.begin(), run_begin.end(), run_begin.begin());
  source_of.resize(begin.back()), cover.resize(begin.back()), runs.resize(run_begin.back());
  std::vector<std::uint32_t> next(begin.begin(), begin.end() - 1),
      next_run(run_begin.begin(), run_begin.end() - 1);
  for_each(
      [&](std::size_t b, std::uint32_t s, const Texels& texels) {
        source_of[next[b]] = std::uint16_t(s), cover[next[b]++] = texels;
      },
      [&](std::size_t b, std::uint32_t s) {
        runs[next_run[b]++] = {std::uint16_t(s), std::uint16_t(s + 1)};
      },
      [&](std::size_t b) { ++runs[next_run[b] - 1].end; });
}

SparseCover::SparseCover(int size, int sources, Table table)
    : size_(size), sources_(sources), table_(std::move(table)) {
  check(size >= 1 && size <= 4096, "size must be 1 to 4096, got ", size);
  const auto check_begins = [&](const std::vector<std::uint32_t>& begin, std::size_t count) {
    check(begin.size() == std::size_t(blocks()) + 1, "expected the entries of ", blocks(),
          " blocks, got ", begin.size());
    check(begin[0] == 0 && std::is_sorted(begin.begin(), begin.end()),
          "expected entries of the blocks one after the other");
    check(begin.back() == count, "expected ", begin.back(), " entries, got ", count);
  };
  check_begins(table_.begin, table_.source_of.size());
  check_begins(table_.begin, table_.cover.size());
  check_begins(table_.run_begin, table_.runs.size());
  for (const std::uint16_t s : table_.source_of)
    check(s < sources_, "expected a source below ", sources_, ", got ", s);
  for (const Run& run : table_.runs)
    check(run.first < run.end && run.end <= sources_, "expected a run of sources below ", sources_,
          ", got ", run.first, " to ", run.end);
}

std::size_t SparseCover::bytes() const {
  const auto of = [](const auto& v) { return v.size() * sizeof v[0]; };
  return of(table_.begin) + of(table_.source_of) + of(table_.cover) + of(table_.run_begin) +
         of(table_.runs);
}

void SparseCover::add(std::span<const glm::vec4> weights, std::span<float> lost) const {
  const auto& [begin, source_of, cover, run_begin, runs] = table_;
  if (cover.empty() && runs.empty()) return;
  std::vector<glm::vec4> scaled(weights.begin(), weights.end());
  for (glm::vec4& w : scaled) w *= 1 / 255.0f;
  std::vector<glm::dvec4> before{glm::dvec4(0)};  // the sum of all weights before a source's
  for (const glm::vec4& w : weights) before.push_back(before.back() + glm::dvec4(w));
  parallel_for(blocks(), 128, [&](int first, int last) {
    for (auto b = std::size_t(first); b < std::size_t(last); ++b) {
      const std::size_t from = begin[b], to = begin[b + 1];
      if (from == to && run_begin[b] == run_begin[b + 1]) continue;
      glm::dvec4 whole(0);
      for (std::size_t r = run_begin[b]; r < run_begin[b + 1]; ++r)
        whole += before[runs[r].end] - before[runs[r].first];
      const glm::vec4 of_runs(whole);
      add_block(source_of.data() + from, cover.data()->data() + from * kTexels, to - from,
                &scaled[0].x, &of_runs.x, &lost[b * 3 * kTexels]);
    }
  });
}

}  // namespace fastibl
