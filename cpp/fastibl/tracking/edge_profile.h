// Where a short straight edge lies in a picture.
#pragma once

#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/tracking/light_reader.h"

namespace fastibl {

inline constexpr int kMostReach = 6;

// A stretch of edge as a pose predicts it, in pixels; white on the left of a → b (y down). Scan
// lines cross it along rows or columns, whichever is nearer to a right angle.
struct ExpectedEdge {
  glm::dvec2 a, b;
  int reach = 2;  // pixels along a scan line with plain black and plain white; at most kMostReach
};

struct FarEdge {
  double offset = 0;     // px from the expected edge to the seen one, towards white
  double noise = 1;      // standard deviation of it against other edges
  double steepness = 0;  // of the profile: slope by step, 1 / px
};

struct NearEdge {
  double excess = 0;  // of the middle between black and white over the expected edge, by the step
  double gain = 0;    // by how much that grows for a px of offset, as this profile has it: rough
  double noise = 1;   // standard deviation of the excess against other edges
  // Where the edge lies between pixel centres: mean of sin 2πx along scan lines, towards white.
  double phase = 0;
};

// Edge position from the area under the profile between black and white, over as much as there is
// room for: from far off, by pixels.
std::optional<FarEdge> find_far_edge(const LightReader& light, const ExpectedEdge& expected);
// Within about a pixel: where the profile, smoothed by a cubic B-spline, is half-way between black
// and white. Both are moved by no symmetric blur.
std::optional<NearEdge> find_near_edge(const LightReader& light, const ExpectedEdge& expected);

}  // namespace fastibl
