// How far the outlines of spheres are from those of a mesh, and how to bring them nearer.
#pragma once

#include <vector>

#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/outlines.h"
#include "fastibl/shadow/sphere_step.h"

namespace fastibl {

// All in voxels. The cost is, over all views, Σ length · |distance of a point of the outline to the
// union of the discs| + Σ area · distance of an uncovered point within. The first sum is the area
// of the symmetric difference to first order; the second keeps holes from opening.
class OutlineFit {
 public:
  explicit OutlineFit(const Outlines& outlines);

  // Adds the equations of a step by least squares whose weights, 1/|distance|, make them least
  // absolute values; returns the cost. moved: how far any sphere may have come since the first
  // call.
  double add_step(const SphereSet& spheres, float moved, float softness,
                  std::vector<SphereEquations>& equations);

 private:
  struct View {
    std::vector<SphereEquations> equations;  // in the axes of the view
    double cost = 0;
  };
  void measure(std::size_t view, const SphereSet& spheres, float moved, float softness);

  const Outlines& outlines_;
  std::vector<float> covered_until_;  // for each block: how far spheres must come to uncover it
  std::vector<View> views_;
};

}  // namespace fastibl
