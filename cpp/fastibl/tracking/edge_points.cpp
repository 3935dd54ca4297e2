#include "fastibl/tracking/edge_points.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr std::size_t kFew = 40;    // edges, which tell too little
constexpr double kMargin = 4;       // px from the picture's border: profiles must lie inside
constexpr double kLeastLength = 1;  // px
// By `spread`: how far from an edge its blur, with that of the scan lines' smoothing, is 2 % and
// 12 %.
constexpr double kTail = 0.8, kCorner = 1.0;
constexpr int kMostNear = 3;                                 // px to either side, from close by
constexpr std::size_t kGainEdges = 300;                      // are enough to tell the usual gain
constexpr double kLargestAliased = 0.15, kLeastPhases = 15;  // of the step; edges
constexpr double kGone = 1.5;        // px; from close by, an edge is not sought further
constexpr double kLeastGain = 0.04;  // of the step, per px: flatter ones are no edges

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

// The part of an edge whose scan lines meet nothing but this edge. Away from the edge, scan lines
// also run along it, the more the more oblique it is.
std::optional<ExpectedEdge> clear_part(const glm::dvec2& a, const glm::dvec2& t, double length,
                                       const TagEdge& edge, double room, const EdgeSearch& search) {
  const double across = std::max(std::abs(t.x), std::abs(t.y)),
               along = std::min(std::abs(t.x), std::abs(t.y));
  const double space = room / across;  // on a scan line
  int reach = search.from_afar ? std::min(int(space), kMostReach)
                               : std::min(int(space - kTail * search.spread), kMostNear);
  const auto part = [&]() -> std::optional<ExpectedEdge> {
    const double cut = kCorner * search.spread + along * reach;
    const double left = length - cut * (edge.from_ends + edge.to_ends);
    if (!(left >= kLeastLength)) return std::nullopt;
    const double from = edge.from_ends ? cut : 0;
    return ExpectedEdge{a + from * t, a + (from + left) * t, reach};
  };
  if (reach < (search.from_afar ? 2 : search.least_reach)) return std::nullopt;
  for (; reach >= 2; --reach)
    if (auto found = part(); found || search.from_afar) return found;
  return search.least_reach > 1 ? std::nullopt : part();
}

// Edges that a search looks at, in turn: calls visit(tag, edge, t, part) with the clear part.
template <typename Visit>
std::size_t visit_edges(const LightReader& light, const BoardPattern& pattern,
                        std::span<const ProjectedTag> tags, const EdgeSearch& search,
                        Visit&& visit) {
  const auto sides = std::size_t(4 * pattern.modules);
  std::size_t total = 0, turn = 0, visited = 0;
  for (const ProjectedTag& tag : tags)
    total += search.from_afar ? sides : pattern.tags[tag.index].edges.size();
  const std::size_t step = search.most > 0 ? std::max<std::size_t>(1, total / search.most) : 1;
  for (const ProjectedTag& tag : tags) {
    const TagPattern& printed = pattern.tags[tag.index];
    const std::size_t count = search.from_afar ? sides : printed.edges.size();
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
      const auto part = clear_part(a, t, length, edge, room, search);
      if (!part) continue;
      ++visited;
      const glm::dvec2 centre = 0.5 * (part->a + part->b);
      const double along = glm::length(centre - a) / length;
      EdgePoint point;
      point.point = (1 - along) * printed.nodes[edge.from] + along * printed.nodes[edge.to];
      point.pixel = centre, point.normal = {t.y, -t.x};
      visit(*part, point);
    }
  }
  return visited;
}

struct Near {
  NearEdge edge;
  int reach;
};

// What the pixel grid adds to the excess of edges of one reach, by their phase: sharp pictures hold
// more than pixels can. By least squares; the edges' own offsets do not depend on the grid.
double aliasing(std::span<const Near> near, int reach) {
  double products = 0, squares = 0;
  for (const Near& n : near) {
    if (n.reach != reach || !(std::abs(n.edge.excess) < kLargestAliased)) continue;
    products += n.edge.phase * n.edge.excess, squares += n.edge.phase * n.edge.phase;
  }
  return squares > kLeastPhases ? products / squares : 0;
}

// Offsets of near edges: their excess divided by the gain, which is nearly the same for all edges
// of one reach; the gain of a single edge is too noisy to divide by.
void set_offsets(std::span<const Near> near, std::vector<EdgePoint>& points) {
  std::array<std::vector<float>, kMostNear + 1> gains;
  const std::size_t step = std::max<std::size_t>(1, near.size() / kGainEdges);
  for (std::size_t i = 0; i < near.size(); i += step)
    gains[std::size_t(near[i].reach)].push_back(float(near[i].edge.gain));
  std::array<double, kMostNear + 1> usual{};
  for (std::size_t k = 0; k < gains.size(); ++k) {
    if (gains[k].empty()) continue;
    const auto middle = gains[k].begin() + std::ptrdiff_t(gains[k].size() / 2);
    std::nth_element(gains[k].begin(), middle, gains[k].end());
    usual[k] = *middle;
  }
  std::array<double, kMostNear + 1> grid{};
  for (int k = 1; k <= kMostNear; ++k) grid[std::size_t(k)] = aliasing(near, k);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < near.size(); ++i) {
    const double middle = usual[std::size_t(near[i].reach)];
    if (!(middle > kLeastGain)) continue;
    // Motion blur makes the gain differ by direction.
    const double gain = std::clamp(near[i].edge.gain, 0.5 * middle, 1.5 * middle);
    EdgePoint point = points[i];
    const double excess =
        near[i].edge.excess - grid[std::size_t(near[i].reach)] * near[i].edge.phase;
    point.offset = excess / gain, point.noise = near[i].edge.noise / middle,
    point.kind = near[i].reach;
    if (std::abs(point.offset) < kGone) points[kept++] = point;
  }
  points.resize(kept);
}

}  // namespace

FoundEdges find_edges(const LightReader& light, const BoardPattern& pattern,
                      std::span<const ProjectedTag> tags, const EdgeSearch& search) {
  FoundEdges found;
  std::vector<Near> near;
  const auto visit = [&](const EdgeSearch& which) {
    found.points.clear(), near.clear();
    found.expected = visit_edges(light, pattern, tags, which,
                                 [&](const ExpectedEdge& expected, EdgePoint& point) {
                                   if (search.from_afar) {
                                     const auto edge = find_far_edge(light, expected);
                                     if (!edge) return;
                                     point.offset = edge->offset, point.noise = edge->noise;
                                     point.steepness = edge->steepness;
                                   } else {
                                     const auto edge = find_near_edge(light, expected);
                                     if (!edge) return;
                                     near.push_back({*edge, expected.reach});
                                   }
                                   found.points.push_back(point);
                                 });
  };
  visit(search);
  if (search.all_of_few && search.most > 0 &&
      found.expected < kFew) {  // most have no room: all that have
    EdgeSearch all = search;
    all.most = 0, found.all = true;
    visit(all);
  }
  if (!search.from_afar) set_offsets(near, found.points);
  return found;
}

}  // namespace fastibl
