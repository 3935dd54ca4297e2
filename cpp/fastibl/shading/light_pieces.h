// A few directions that stand for all light of a map: parts of its faces that hold about the same
// amount of light.
#pragma once

#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/shading/light_sums.h"

namespace fastibl {

// Squares of the faces, each with no more than 1/count of the light of any channel; texels are cut
// where they hold more. There are up to some times `count` squares.
class LightPieces {
 public:
  LightPieces(const CubeMap& map, const glm::mat3& frame_from_map, int count);
  LightPieces(const LightPieces&) = delete;  // arrays point into it
  LightPieces& operator=(const LightPieces&) = delete;

  const LitDirections& directions() const { return arrays_; }
  std::size_t count() const { return count_; }  // without those that fill up the last Lanes

 private:
  std::vector<float> x_, y_, z_, solid_angles_, channels_[3];
  std::size_t count_ = 0;
  LitDirections arrays_{};
};

}  // namespace fastibl
