// A board's tags as a pose projects them into the picture, and how well the picture agrees.
#pragma once

#include <vector>

#include "fastibl/scene/camera.h"
#include "fastibl/tracking/light_reader.h"
#include "fastibl/tracking/rows.h"
#include "fastibl/tracking/tag_edges.h"

namespace fastibl {

struct ProjectedTag {
  std::size_t index = 0;          // in the pattern
  std::vector<glm::dvec2> nodes;  // pixels
  double module = 0;              // px, the shorter way across, at the tag's centre
};

// The tags of which at least a part may be in the picture. rows: of a rolling shutter, null for
// none.
std::vector<ProjectedTag> project_tags(const BoardPattern& pattern, const Camera& camera,
                                       const Lens& lens, const Pose& camera_from_marker,
                                       const Rows* rows = nullptr);

// Share of the picture's height at which the board is, 0 to 1.
double middle_share(const BoardPattern& pattern, const Camera& camera, const Lens& lens,
                    const Pose& camera_from_marker);

// Middle of a data module, pixels.
glm::dvec2 module_middle(const BoardPattern& pattern, const ProjectedTag& tag, int row, int column);

inline constexpr double kCodeSeen = 0.6;  // code_match() from which a tag counts as seen

// Correlation of the picture at the data modules with the tag's code, −1 to 1; other codes of the
// family reach 0.39. 0 where less than half of the tag is in the picture, or it is uniform there.
double code_match(const LightReader& light, const BoardPattern& pattern, const ProjectedTag& tag);

}  // namespace fastibl
