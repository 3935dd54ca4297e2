// A shadow map prepared for many look-ups: a picture looks it up at every pixel of the plane.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/scene/shadow_texels.h"

namespace fastibl {

// Keeps no reference to the map it is made from. Making it costs about 1 ns a texel, a look-up as
// much.
class ShadowLookUp {
 public:
  explicit ShadowLookUp(const ShadowMap& map);
  // At each point the same bits as ShadowMap::sample.
  void sample(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const;
  bool empty() const { return levels_.empty() && !uncoded_; }  // the ratio is 1 everywhere
  // As those of the map.
  glm::vec2 centre() const { return centre_; }
  float reach() const { return reach_; }

  // Codes of a texel and of the one below it, red to blue; the last pair is unused.
  struct alignas(16) Column {
    std::int16_t code[4][2];
  };
  struct Level {
    ShadowPlace place;
    std::vector<Column> columns;  // size + 1 a row: the last one is repeated
  };

 private:
  std::vector<Level> levels_;          // the finest first
  std::optional<ShadowMap> uncoded_;  // instead, for ranges above kMostCoded
  glm::vec2 centre_;
  float reach_;
};

}  // namespace fastibl
