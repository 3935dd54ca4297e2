// Refines tag corners from the tag's sides, measured in linear light.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

struct RefineOptions {
  int rounds = 3;             // each round searches along the sides that the last one found
  double reach_px = 5;        // longest search to either side of a tag's side
  double longest_move = 0.1;  // of a corner, in tag sides (and at least 2 px); further is no repair
  int most_samples = 48;      // along one side
};

// How far the measured sides of a tag may lie beside their places, px, standard deviations.
struct SideErrors {
  double scatter = 0;  // of each side's middle, as the scatter of its points tells
  double lift = 0;     // of all sides alike, outwards, by blur beside narrow borders
};

struct RefinedTag {
  DetectedTag tag;
  std::optional<SideErrors> sides;  // nothing where they could not be measured
};

// Returns the same tags with corners where straight lines through the sides' edge points meet. An
// edge point is where the profile across the side, normalised between black and white, has its
// area. No symmetric blur moves that, but only in linear light (gamma spreads white and shrinks a
// tag by about 0.4 px), so values are decoded with the camera's response. Lines are straight in
// undistorted coordinates; for fisheye and 360° cameras, on a plane in front of each tag. A tag
// with a side that cannot be measured keeps its corners.
std::vector<RefinedTag> refine_tags(ImageView<const std::uint8_t> grey,
                                    const std::vector<DetectedTag>& tags, int border_bits,
                                    const Camera& camera, const RefineOptions& options = {});

// The tags alone.
std::vector<DetectedTag> refine_corners(ImageView<const std::uint8_t> grey,
                                        const std::vector<DetectedTag>& tags, int border_bits,
                                        const Camera& camera, const RefineOptions& options = {});

}  // namespace fastibl
