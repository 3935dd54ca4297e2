// Finds a board's tags that lie pixels away from where they were expected.
#pragma once

#include <span>
#include <vector>

#include "fastibl/tracking/light_reader.h"
#include "fastibl/tracking/projected_tags.h"

namespace fastibl {

struct FoundTag {
  std::size_t which = 0;  // in the list that was given
  glm::dvec2 shift{0};    // whole pixels from where it was projected
  double match = 0;       // match of its code there, 0.6 to 1
};

// Finds first one of the largest tags, up to `radius` pixels away in x and y, then the tags beside
// it, for which it tells where to look. Empty where none of the largest shows its code.
std::vector<FoundTag> find_tags(const LightReader& light, const BoardPattern& pattern,
                                std::span<const ProjectedTag> tags, double radius);

}  // namespace fastibl
