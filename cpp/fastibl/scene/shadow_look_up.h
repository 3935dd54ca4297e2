// A shadow map made ready for many points: a picture looks it up at every pixel of the plane.
#pragma once

#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/scene/shadow_texels.h"

namespace fastibl {

// Keeps nothing of the map it is made from. Making it costs about 1 ns a texel, a look-up as much.
class ShadowLookUp {
 public:
  explicit ShadowLookUp(const ShadowMap& map);
  // The bits of ShadowMap::sample at each point.
  void sample(std::span<const glm::vec2> points, std::span<glm::vec3> ratios) const;
  bool empty() const { return levels_.empty(); }  // the ratio is 1 everywhere
  // As those of the map.
  glm::vec2 centre() const { return centre_; }
  float reach() const { return reach_; }

  // Codes of a texel and of the one below it, red to blue; the last pair is none.
  struct alignas(16) Column {
    std::int16_t code[4][2];
  };
  struct Level {
    ShadowPlace place;
    std::vector<Column> columns;  // size + 1 a row: the last one twice
  };

 private:
  std::vector<Level> levels_;  // the finest first
  glm::vec2 centre_;
  float reach_;
};

}  // namespace fastibl
