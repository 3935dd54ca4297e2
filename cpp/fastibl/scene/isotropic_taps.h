// The taps of round GGX lobes, computed once for all of them.
#pragma once

#include <vector>

#include "fastibl/core/simd.h"
#include "fastibl/scene/ggx.h"

namespace fastibl {

// A table over kRoughnesses, from the least to 1, and kAngles between view and normal, denser
// towards grazing ones. Each node has kGgxTaps.
class IsotropicTaps {
 public:
  static constexpr int kRoughnesses = 32, kAngles = 48;
  static constexpr float kLeastRoughness = 0.14142136f;  // of kSmallestAlpha

  static const IsotropicTaps& table();  // made when first asked for: a few ms
  // The taps of ggx_taps() with as many taps, but for the table's interpolation. unit_view: in the
  // surface's frame.
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
