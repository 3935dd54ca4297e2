// Finds where a short straight edge lies in a picture.
#pragma once

#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/tracking/light_reader.h"

namespace fastibl {

inline constexpr int kMostReach = 6;

// A piece of an edge as a pose predicts it, in pixels; white lies on the left of a → b (y down).
// Scan lines cross it along rows or columns, whichever is nearer to a right angle.
struct ExpectedEdge {
  glm::dvec2 a, b;
  int reach = 2;  // pixels along a scan line with plain black and plain white; at most kMostReach
};

struct FarEdge {
  double offset = 0;     // px from the expected edge to the edge seen, towards white
  double noise = 1;      // its standard deviation relative to other edges
  double steepness = 0;  // of the profile: slope divided by step, 1 / px
};

struct NearEdge {
  double excess = 0;  // middle of black and white less the light at the expected edge, by the step
  double gain = 0;    // its growth for one px of offset, from this profile alone: rough
  double noise = 1;   // standard deviation of the excess relative to other edges
  // Where the edge lies between pixel centres: the mean of sin 2πx along scan lines, towards white.
  double phase = 0;
};

// Finds the edge from the area under the profile between black and white, over as many pixels as
// there is room for. For edges that are pixels away.
std::optional<FarEdge> find_far_edge(const LightReader& light, const ExpectedEdge& expected);
// For edges within about a pixel: where the profile, smoothed by a cubic B-spline, is half-way
// between black and white. No symmetric blur shifts either result.
std::optional<NearEdge> find_near_edge(const LightReader& light, const ExpectedEdge& expected);

}  // namespace fastibl
