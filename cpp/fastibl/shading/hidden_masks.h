// What is hidden from every entry of a VertexVisibility, a bit for each cell, made once.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "fastibl/scene/vertex_visibility.h"
#include "fastibl/shading/hidden_cells.h"

namespace fastibl {

class HiddenMasks {
 public:
  // size: cells along an edge. Does nothing where these masks are kept already.
  void keep(const std::shared_ptr<const VertexVisibility>& visibility, int size);
  const HiddenCells::Mask* of(std::size_t entry) const { return &masks_[first_[entry]]; }
  // Those of all entries, and where an entry's begin in them.
  const std::vector<std::uint16_t>& all() const { return masks_; }
  std::size_t first(std::size_t entry) const { return first_[entry]; }

 private:
  std::shared_ptr<const VertexVisibility> visibility_;
  int size_ = 0;
  std::vector<std::size_t> first_;  // where each entry begins in masks_
  std::vector<std::uint16_t> masks_;
};

}  // namespace fastibl
