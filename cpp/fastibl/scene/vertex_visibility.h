// Which directions an object leaves free around its vertices.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace fastibl {

// For each vertex, the cells of an OctahedralGrid in the mesh's frame, above the vertex's tangent
// plane, that the object blocks, as runs along the grid's curve. Blocked regions have few edges, so
// that runs are short to store and, with sums along the curve, quick to add up. Surfaces that are
// seen from behind have all vertices once more, after the others, with the normals reversed.
struct VertexVisibility {
  int size = 0;  // cells along an edge of the grid; 0: nothing is known
  int sides = 1;
  std::vector<std::uint32_t> first;  // where each vertex begins in `edges`, and one more at the end
  std::vector<std::uint16_t> edges;  // first cell of a run, first one after it, and so on

  std::size_t entries() const { return first.empty() ? 0 : first.size() - 1; }
  std::size_t vertex_count() const { return entries() / std::size_t(sides); }
  std::span<const std::uint16_t> edges_of(std::size_t entry) const {
    return {edges.data() + first[entry], edges.data() + first[entry + 1]};
  }
  bool blocks_nothing() const { return edges.empty(); }
  bool operator==(const VertexVisibility&) const = default;
};

// Appends the runs of cells that are not 0.
inline void append_runs(std::span<const std::uint8_t> blocked, std::vector<std::uint16_t>& edges) {
  std::uint8_t before = 0;
  for (std::size_t k = 0; k < blocked.size(); ++k)
    if (blocked[k] != before) edges.push_back(std::uint16_t(k)), before = blocked[k];
  if (before) edges.push_back(std::uint16_t(blocked.size()));
}

}  // namespace fastibl
