// Cuts a polygon by a plane.
#pragma once

#include <cstddef>
#include <vector>

namespace fastibl {

// Keeps the part of a convex polygon where at(corner) is not negative: Sutherland and Hodgman 1974,
// Reentrant Polygon Clipping. crossing(inner, outer, inside, outside): the corner where an edge
// meets the plane, by its ends and what `at` is there. kept: scratch.
template <typename Corner, typename At, typename Crossing>
void cut_polygon(std::vector<Corner>& polygon, std::vector<Corner>& kept, const At& at,
                 const Crossing& crossing) {
  kept.clear();
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Corner &a = polygon[i], &b = polygon[i + 1 < polygon.size() ? i + 1 : 0];
    const double at_a = at(a), at_b = at(b);
    if (at_a >= 0) kept.push_back(a);
    if (at_a >= 0 && at_b < 0) kept.push_back(crossing(a, b, at_a, at_b));
    if (at_a < 0 && at_b >= 0) kept.push_back(crossing(b, a, at_b, at_a));
  }
  polygon.swap(kept);
}

}  // namespace fastibl
