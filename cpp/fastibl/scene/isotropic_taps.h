// The taps of round GGX lobes, worked out once for all of them.
#pragma once

#include <vector>

#include "fastibl/core/simd.h"
#include "fastibl/scene/ggx.h"

namespace fastibl {

// Between kRoughnesses from the least to 1 and kAngles of the view from the normal, closer towards
// grazing ones, kGgxTaps each.
class IsotropicTaps {
 public:
  static constexpr int kRoughnesses = 32, kAngles = 48;
  static constexpr float kLeastRoughness = 0.14142136f;  // of kSmallestAlpha

  static const IsotropicTaps& table();  // made when first asked for: a few ms
  // Within the table's interpolation those of ggx_taps() with as many. unit_view: surface's frame.
  GgxTaps at(glm::vec3 unit_view, float roughness) const;

  static_assert(kGgxTaps == 8);
  struct Node {
    Float8 across, up;  // direction: away from the view, along the normal
    Float8 width, weight;
    float albedo;
  };
  const Node* nodes() const { return nodes_.data(); }  // kAngles of each roughness

 private:
  IsotropicTaps();
  std::vector<Node> nodes_;  // by roughness, then angle
};

}  // namespace fastibl
