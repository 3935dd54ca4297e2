// Splits the light of the sky into two parts: what is far brighter than the mean, as a few
// directions of their own; and the rest, which is smooth enough to be taken as even over each cell
// of the sky.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/shadow/sky_cells.h"

namespace fastibl {

struct SkySplitOptions {
  float threshold = 8;  // radiance above this many times the cosine-weighted mean gets directions
  // The directions are left out where they would hold less than this share of the irradiance: no
  // ratio then changes by more than the cells' error for this share.
  float least_share = 0.02f;
  // A direction is split in two while its share times the root of its angular radius is above this.
  // From 1e-3 to 5e-4, the worst point of ten lights went from 0.056 to 0.026. What a single
  // direction hides also appears and vanishes at once as a near light's place becomes known better:
  // from 5e-4 to this, the largest such step in a recording of 300 frames went from 0.0056 to
  // 0.0029.
  float tolerance = 2.5e-4f;
  int most_directions = 256;
};

// Tells which texels belong to which direction. It is kept while the light changes: weights are
// then linear in the map, and nothing flickers.
class SkySplit {
 public:
  SkySplit() = default;
  explicit SkySplit(const CubeMap& radiance, const SkySplitOptions& options = {});

  // Towards the lights, unit length, z > 0, marker frame.
  const std::vector<glm::vec3>& directions() const { return directions_; }

  struct Weights {
    std::vector<glm::vec4> directions;  // xyz: irradiance of the plane by each
    std::vector<glm::vec3> rest;        // radiance left in the texels of a level, 6 n²
    int rest_size = 0;                  // n
    glm::dvec3 irradiance{0};           // of the plane, from the whole map at rest_size
  };
  // radiance: a map of size().
  Weights weigh(const CubeMap& radiance) const;
  int size() const { return size_; }
  // Share of the irradiance that this split does not suit: of directions that hold more than four
  // times what they held, and of new light in the rest. 0 below 2 %.
  float misfit(const Weights& weights) const;
  // The directions within kCompact of the strongest of them, if these hold at least that share of
  // the irradiance when it was split; otherwise none.
  std::vector<int> compact(float least_share) const;
  static constexpr float kCompact = 0.05f;  // radians: three degrees
  // Share of the irradiance that has moved elsewhere, by the split's own directions and rests.
  float moved(const Weights& before, const Weights& after) const;

 private:
  // The part of a texel's radiance that belongs to a direction.
  struct Piece {
    std::uint8_t level;
    std::uint8_t face;
    std::uint16_t x, y;
    std::uint16_t direction;
    std::int32_t rest;  // texel of the rest that it is taken from
    float flux;         // irradiance of the plane for radiance 1
    float taken;        // radiance taken from the rest for radiance 1
  };
  struct Element;
  void collect(const CubeMap& radiance, const glm::dvec3& scale, const SkySplitOptions& options,
               std::vector<Element>& elements) const;
  void group(const SkySplitOptions& options, std::vector<Element>& elements);

  int size_ = 0;  // of the map
  float threshold_ = 0;
  std::vector<glm::vec3> directions_;
  std::vector<float> shares_;        // of each direction, when it was split
  float bright_ = 0;                 // share that was above twice the threshold in the rest
  std::vector<float> rest_cosines_;  // × solid angle, of the texels of the rest
  std::vector<Piece> pieces_;
};

// Sums the radiance of texels to irradiance by cells of the sky, as seen by an object that is
// turned about z by `turn` radians.
class CellSums {
 public:
  CellSums() = default;
  CellSums(const SkyCells& cells, int size, float turn);
  int size() const { return size_; }
  float turn() const { return turn_; }
  // rest: 6 size² texels. Returns one value for each cell, w is 0; never below 0.
  std::vector<glm::vec4> sum(std::span<const glm::vec3> rest) const;

 private:
  struct Entry {
    std::int32_t texel, cell;
    float cosine;  // × solid angle
  };
  int size_ = 0, cells_ = 0;
  float turn_ = 0;
  std::vector<Entry> entries_;
};

}  // namespace fastibl
