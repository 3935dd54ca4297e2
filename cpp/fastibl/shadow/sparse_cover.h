// How much of each source's light every texel of a plane map misses, and its sum for given weights.
// A source is a cell of the sky, of which a texel can miss a part, or one direction. Most texels
// see nearly all of the sky, so only what is missed is stored: about a tenth. Half of that are
// whole blocks of texels that miss all of a source, and such sources follow each other: they are
// stored as runs.
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

  // Sources one after the other that cover a block wholly.
  struct Run {
    std::uint16_t first, end;
    bool operator==(const Run&) const = default;
  };
  // What covers the blocks, in the order of the blocks. Entries of block b, which is covered in
  // part, are [begin[b], begin[b + 1]); its runs are [run_begin[b], run_begin[b + 1]).
  struct Table {
    std::vector<std::uint32_t> begin;
    std::vector<std::uint16_t> source_of;
    std::vector<Texels> cover;
    std::vector<std::uint32_t> run_begin;
    std::vector<Run> runs;
    bool operator==(const Table&) const = default;
  };

  SparseCover() = default;
  SparseCover(int size, std::span<const Source> sources);
  // Built from what table() returned; throws std::invalid_argument if that is not possible.
  SparseCover(int size, int sources, Table table);

  int size() const { return size_; }
  int sources() const { return sources_; }
  int blocks() const { return blocks_of(size_) * blocks_of(size_); }
  std::size_t bytes() const;
  const Table& table() const { return table_; }

  // Adds Σ weight × cover of all sources to `lost`, in blocks: for each block the red of its 16
  // texels, then green, then blue. weights: one for each source; a covered texel gets all of it.
  void add(std::span<const glm::vec4> weights, std::span<float> lost) const;
  bool operator==(const SparseCover&) const = default;

 private:
  static int blocks_of(int size) { return (size + kBlock - 1) / kBlock; }
  int size_ = 0, sources_ = 0;
  Table table_;
};

}  // namespace fastibl
