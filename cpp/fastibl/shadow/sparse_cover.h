// How much of each source's light every texel of a plane map misses, and its sum for given weights.
// A source is a cell of the sky, of which a texel can miss a part, or one direction. Most texels
// see nearly all of the sky, so only what is missed is stored: about a tenth.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/shadow/plane_bits.h"

namespace fastibl {

// Texels are stored in blocks of 4 × 4, row by row; so are the blocks of a map.
class SparseCover {
 public:
  static constexpr int kBlock = 4;
  using Texels = std::array<std::uint8_t, kBlock * kBlock>;  // 255: covered

  // What one source covers: the blocks where it covers anything, in ascending order.
  struct Source {
    std::vector<std::int32_t> blocks;
    std::vector<Texels> cover;
  };
  // The mean of the bit images of a source, all of `size`; at least one, at most 63.
  static Source source(std::span<const PlaneBits> images);

  SparseCover() = default;
  SparseCover(int size, std::span<const Source> sources);
  // Built from what the accessors below returned; throws std::invalid_argument if that is not
  // possible.
  SparseCover(int size, int sources, std::vector<std::uint32_t> begin,
              std::vector<std::uint16_t> source_of, std::vector<Texels> cover);

  int size() const { return size_; }
  int sources() const { return sources_; }
  int blocks() const { return blocks_of(size_) * blocks_of(size_); }
  std::size_t bytes() const;
  // Entries of block b are [begin()[b], begin()[b + 1]).
  const std::vector<std::uint32_t>& begin() const { return begin_; }
  const std::vector<std::uint16_t>& source_of() const { return source_of_; }
  const std::vector<Texels>& cover() const { return cover_; }

  // Adds Σ weight × cover of all sources to `lost`, in blocks: for each block the red of its 16
  // texels, then green, then blue. weights: one for each source; a covered texel gets all of it.
  void add(std::span<const glm::vec4> weights, std::span<float> lost) const;
  bool operator==(const SparseCover&) const = default;

 private:
  static int blocks_of(int size) { return (size + kBlock - 1) / kBlock; }
  int size_ = 0, sources_ = 0;
  std::vector<std::uint32_t> begin_;
  std::vector<std::uint16_t> source_of_;
  std::vector<Texels> cover_;
};

}  // namespace fastibl
