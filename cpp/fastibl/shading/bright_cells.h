// The brightest cells of a map's light, by rays at single places. A vertex knows of a cell whether
// it is hidden, all of it or none, and nothing of what lies between vertices.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/scene/bvh.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/shading/hidden_cells.h"
#include "fastibl/shading/light_sums.h"
#include "fastibl/shading/lobe_cells.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

// What a corner of a triangle knows of the bright cells, a bit for each of them.
struct CellStates {
  std::uint64_t hidden = 0;  // as blocked_irradiance() has it
  std::uint64_t low = 0;     // below the tangent plane, where nothing is known
  std::uint64_t free = 0;    // neither
  std::uint64_t mixed = 0;   // above it, and not all cells beside it are like it
};

class BrightCells {
 public:
  static constexpr int kMost = 64;           // cells
  static constexpr std::size_t kStarts = 4;  // of rays from a pixel
  // A cell with less of the light is left to the vertices.
  static constexpr float kLeastShare = 0.004f;
  static constexpr float kCounts = 0.001f;  // of what a lobe sees: less of it is left out

  BrightCells() = default;
  // light: of the map. rays_from_light: rotation from its frame to that of the bvh that is asked;
  // light_from_map likewise. Keeps no reference.
  BrightCells(const CubeMap& map, const CellLight& light, const glm::mat3& light_from_map,
              const glm::mat3& rays_from_light);

  struct Cell {
    glm::vec3 direction;       // of its middle
    glm::mat3 moments;         // columns by channel: ∫ L w dω
    float share;               // of all light; its rays have equal parts of it
    float doubtful;            // cosine below which a corner does not tell
    std::size_t first, count;  // of its rays
    std::size_t first_count;   // that are traced before the others
  };

  bool empty() const { return cells_.empty(); }
  const std::vector<Cell>& cells() const { return cells_; }
  const std::vector<int>& indices() const { return indices_; }  // among the cells of the light
  const std::vector<glm::vec3>& rays() const { return rays_; }  // in the bvh's frame, unit
  // hidden: of a corner, for each cell of the light. normal: unit, in the light's frame.
  CellStates states(const HiddenCells::Mask* hidden, glm::vec3 normal) const;

  struct Corner {
    CellStates states;
    glm::vec3 normal;  // unit, in the light's frame
  };
  using Corners = std::array<Corner, 3>;
  // The cells of which corners do not tell whether they are hidden from places between them.
  static std::uint64_t unsure(const CellStates& a, const CellStates& b, const CellStates& c);

  // The cells and their rays as seen from a place.
  struct Seen {
    std::vector<std::uint8_t> free;   // by ray
    std::vector<std::uint8_t> other;  // used while looking
    std::array<float, kMost> lost;    // by cell: the part of its light that is hidden
  };
  // Traces rays to the cells in `asked` that are not below the horizon; the others are as the
  // corners say. starts: of the rays; one, or kStarts over a pixel, whose mean this then is.
  // normal: unit, in the light's frame. Returns how many rays it traced.
  int look(const Bvh& bvh, std::span<const glm::vec3> starts, glm::vec3 normal,
           const Corners& corners, std::uint64_t asked, Seen& seen) const;
  // Change of the share of its irradiance that reaches the place, by channel, where what is seen of
  // the cells in `asked` takes the place of what is interpolated between the corners' shares.
  // irradiance: of the corners and the place, that of the map with nothing hidden. free: the share
  // that was interpolated; no more light comes back than is missing from it.
  glm::vec3 change(const Seen& seen, glm::vec3 normal, const Corners& corners, glm::vec3 weights,
                   const std::array<glm::vec3, 4>& irradiance, glm::vec3 free,
                   std::uint64_t asked) const;
  // The cells whose light counts in a lobe: of which a thousandth of what it sees comes. rest: what
  // it sees of all others, as LobeCells has it without them.
  std::uint64_t counted(glm::vec3 normal, glm::vec3 view, const LobeHeight& lobe, float rest) const;
  float width() const;  // of a cell, radians
  // The parts of the map's light in a disc that each cell has, in all 1. direction: unit, in the
  // light's frame. Returns the cells, a bit for each; none where its light is in no cell.
  std::uint64_t parts_towards(glm::vec3 direction, float sin_radius,
                              std::array<float, kMost>& parts) const;
  // Takes the rays in a disc out of what lobe_sums() and counted() sum up. Returns their light, by
  // all light of the map.
  float leave_out(glm::vec3 direction, float sin_radius);
  float left(std::size_t cell) const { return lit_cells_.flux[cell]; }  // of its share, for those
  bool is_left_out(std::size_t ray) const { return lit_rays_.flux[ray] == 0; }
  // Sums of these cells' light in a lobe. Adds up how many rays it looked at.
  LobeCells::Sums lobe_sums(const Seen& seen, glm::vec3 normal, glm::vec3 view,
                            const LobeHeight& lobe, std::uint64_t counted, int& looked) const;

 private:
  int size_ = 0;
  std::vector<int> indices_;
  std::vector<Cell> cells_;
  std::vector<glm::vec3> rays_;
  // In the light's frame, for LitDirections; of rays, and of the middles of cells. Flux counts in
  // the first channel alone.
  struct Lit {
    std::vector<float> x, y, z, flux, none;
    void add(glm::vec3 direction, float flux);
    void pad();
    LitDirections directions(const std::vector<float>& flux) const;
    bool within(std::size_t i, glm::vec3 direction, float sin_radius) const;
  };
  Lit lit_rays_, lit_cells_;
};

}  // namespace fastibl
