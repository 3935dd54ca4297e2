// How sure a pose by corners is: from how well the tags' sides were measured, and from how well the
// corners agree with the pose.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "fastibl/scene/camera.h"
#include "fastibl/tracking/fit.h"
#include "fastibl/tracking/refine.h"

namespace fastibl {

// A tag's corners as they went into a fit.
struct CornersOfTag {
  std::array<Match, 4> matches;
  std::optional<SideErrors> sides;  // of measured ones
};

// Covariance as Tracked::covariance. noise: px, expected of a corner in x or y where its tag's
// sides are not measured, by Match::noise; without any measured tag, it is the least there is.
// Nothing where the corners leave a motion open.
std::optional<std::array<double, 36>> corner_covariance(std::span<const CornersOfTag> tags,
                                                        const Lens& lens, const PoseFit& fit,
                                                        double noise);

}  // namespace fastibl
