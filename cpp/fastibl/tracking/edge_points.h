// All edges of the tags in a picture, measured against where a pose expects them.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "fastibl/tracking/edge_profile.h"
#include "fastibl/tracking/projected_tags.h"

namespace fastibl {

struct EdgePoint {
  glm::dvec2 point;      // on the board, marker frame
  glm::dvec2 pixel;      // where the pose expects the point
  glm::dvec2 normal;     // towards white
  double offset = 0;     // px along the normal to where the edge was found
  double steepness = 0;  // as FarEdge
  int kind = 0;          // points of one kind were measured alike, from 0 to 7
  double noise = 1;      // standard deviation of the offset relative to others of its kind
};

struct EdgeSearch {
  bool from_afar =
      false;  // the tags' sides alone, from pixels away; otherwise all edges, from close by
  std::size_t most = 0;     // edges looked at, spread evenly; 0: all
  double spread = 1.1;      // px; half an edge's width in the picture
  int least_reach = 1;      // px on either side that an edge needs, from close by: 1 or 2
  bool all_of_few = false;  // look at all edges after all, where most have no room
};

struct FoundEdges {
  std::vector<EdgePoint> points;
  std::size_t expected = 0;  // edges that the picture should show
  bool all = false;          // all edges were looked at, since there were few
};

FoundEdges find_edges(const LightReader& light, const BoardPattern& pattern,
                      std::span<const ProjectedTag> tags, const EdgeSearch& search);

}  // namespace fastibl
