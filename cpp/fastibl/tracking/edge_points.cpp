#include "fastibl/tracking/edge_points.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kMargin = 4;       // px from the picture's border: profiles must lie inside
constexpr double kLeastLength = 1;  // px
// By `spread`: how far from an edge its blur, with that of the scan lines' smoothing, is 2 % and
// 12 %.
constexpr double kTail = 1.85, kCorner = 1.0;
constexpr int kMostNear = 4;  // px to either side, from close by

double cross(const glm::dvec2& a, const glm::dvec2& b) { return a.x * b.y - a.y * b.x; }

// Height of the module beside an edge, px.
double height_px(const ProjectedTag& tag, const TagEdge& edge, const glm::dvec2& direction,
                 int stride) {
  const bool level = std::abs(int(edge.to) - int(edge.from)) == 1;
  const int step = level ? stride : 1;
  const int count = int(tag.nodes.size());
  const bool last = level ? edge.from + stride >= count : edge.from % stride == stride - 1;
  const std::size_t other = std::size_t(edge.from + (last ? -step : step));
  return std::abs(cross(direction, tag.nodes[other] - tag.nodes[edge.from]));
}

// The part of an edge whose scan lines meet nothing but this edge. Away from the edge they also run
// along it, the more the more aslant it is.
std::optional<ExpectedEdge> clear_part(const glm::dvec2& a, const glm::dvec2& t, double length,
                                       const TagEdge& edge, double room, const EdgeSearch& search) {
  const double across = std::max(std::abs(t.x), std::abs(t.y)),
               along = std::min(std::abs(t.x), std::abs(t.y));
  const double space = room / across;  // on a scan line
  int reach = search.far ? std::min(int(space), kMostReach)
                         : std::min(int(space - kTail * search.spread), kMostNear);
  const auto part = [&]() -> std::optional<ExpectedEdge> {
    const double cut = kCorner * search.spread + along * reach;
    const double left = length - cut * (edge.from_ends + edge.to_ends);
    if (!(left >= kLeastLength)) return std::nullopt;
    const double from = edge.from_ends ? cut : 0;
    return ExpectedEdge{a + from * t, a + (from + left) * t, reach};
  };
  if (reach < (search.far ? 2 : 1)) return std::nullopt;
  for (; reach >= 2; --reach)
    if (auto found = part(); found || search.far) return found;
  return part();
}

}  // namespace

FoundEdges find_edges(const LightReader& light, const BoardPattern& pattern,
                      std::span<const ProjectedTag> tags, const EdgeSearch& search) {
  FoundEdges found;
  std::size_t total = 0;
  const auto sides = std::size_t(4 * pattern.modules);
  for (const ProjectedTag& tag : tags)
    total += search.far ? sides : pattern.tags[tag.index].edges.size();
  const std::size_t step = search.most > 0 ? std::max<std::size_t>(1, total / search.most) : 1;
  found.points.reserve(total / step + 1);
  std::size_t turn = 0;
  for (const ProjectedTag& tag : tags) {
    const TagPattern& printed = pattern.tags[tag.index];
    const std::size_t count = search.far ? sides : printed.edges.size();
    for (std::size_t k = 0; k < count; ++k) {
      if (turn++ % step != 0) continue;
      const TagEdge& edge = printed.edges[k];
      const glm::dvec2 a = tag.nodes[edge.from], b = tag.nodes[edge.to], middle = 0.5 * (a + b);
      if (!(middle.x > kMargin && middle.y > kMargin && middle.x < light.width() - kMargin &&
            middle.y < light.height() - kMargin))
        continue;
      const double length = glm::length(b - a);
      if (!(length >= kLeastLength && length < light.width())) continue;
      const glm::dvec2 t = (b - a) / length;
      const double room =
          height_px(tag, edge, t, pattern.nodes()) * std::min(edge.black, edge.white);
      const auto expected = clear_part(a, t, length, edge, room, search);
      if (!expected) continue;
      ++found.expected;
      const auto at =
          search.far ? find_far_edge(light, *expected) : find_near_edge(light, *expected);
      if (!at) continue;
      const glm::dvec2 centre = 0.5 * (expected->a + expected->b);
      const double along = glm::length(centre - a) / length;
      found.points.push_back(
          {(1 - along) * printed.nodes[edge.from] + along * printed.nodes[edge.to], centre,
           glm::dvec2(t.y, -t.x), at->offset, at->steepness, std::sqrt(at->variance)});
    }
  }
  return found;
}

}  // namespace fastibl
