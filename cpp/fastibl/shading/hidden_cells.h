// What an object hides around one vertex, made to be asked many times.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

namespace fastibl {

// A bit for each cell of an OctahedralGrid, in the order of its curve.
class HiddenCells {
 public:
  static constexpr int kGroup = 16;  // cells that one mask holds

  // size: cells along an edge, a power of two.
  explicit HiddenCells(int size)
      : size_(size), words_((std::size_t(size) * std::size_t(size) + 63) / 64) {}

  // Sets the runs of VertexVisibility::edges, of a grid of `own` cells along an edge. Where those
  // cells are finer than these, a half-hidden cell counts as hidden.
  void set(std::span<const std::uint16_t> edges, int own) {
    std::fill(words_.begin(), words_.end(), 0);
    const int finer = 2 * std::countr_zero(unsigned(own)),
              coarser = 2 * std::countr_zero(unsigned(size_));
    const int down = std::max(finer - coarser, 0), up = std::max(coarser - finer, 0);
    const std::uint32_t half = (1u << down) / 2;
    for (std::size_t e = 0; e + 1 < edges.size(); e += 2)
      add(((edges[e] + half) >> down) << up, ((edges[e + 1] + half) >> down) << up);
  }
  bool operator[](int cell) const { return words_[std::size_t(cell) / 64] >> (cell % 64) & 1; }

  // Each for 16 cells in a row.
  using Mask [[gnu::may_alias]] = std::uint16_t;
  const Mask* masks() const { return reinterpret_cast<const Mask*>(words_.data()); }

 private:
  static_assert(std::endian::native == std::endian::little, "masks lie in words, the first lowest");

  void add(std::uint32_t begin, std::uint32_t end) {
    if (begin >= end) return;
    std::uint64_t* word = &words_[begin / 64];
    std::uint64_t* const last = &words_[(end - 1) / 64];
    const std::uint64_t first_bits = ~std::uint64_t{0} << (begin % 64),
                        last_bits = ~std::uint64_t{0} >> (63 - (end - 1) % 64);
    if (word == last) {
      *word |= first_bits & last_bits;
      return;
    }
    *word |= first_bits;
    while (++word < last) *word = ~std::uint64_t{0};
    *last |= last_bits;
  }

  int size_;
  std::vector<std::uint64_t> words_;
};

}  // namespace fastibl
