// All edges of the tags that a picture shows, measured against where a pose expects them.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "fastibl/tracking/edge_profile.h"
#include "fastibl/tracking/projected_tags.h"

namespace fastibl {

struct EdgePoint {
  glm::dvec2 point;      // of the board, marker frame
  glm::dvec2 pixel;      // where the pose expects it
  glm::dvec2 normal;     // towards white
  double offset = 0;     // px along the normal to where it was found
  double steepness = 0;  // as FoundEdge
  double noise = 1;      // standard deviation of the offset against the other points
};

struct EdgeSearch {
  bool far = false;      // the tags' sides alone, from pixels away; else all edges, from close by
  std::size_t most = 0;  // edges looked at, spread evenly
  double spread = 1.1;   // px; half the width of an edge as the picture shows it
};

struct FoundEdges {
  std::vector<EdgePoint> points;
  std::size_t expected = 0;  // edges that the picture should have shown
};

FoundEdges find_edges(const LightReader& light, const BoardPattern& pattern,
                      std::span<const ProjectedTag> tags, const EdgeSearch& search);

}  // namespace fastibl
