// Measures whether a board lies where its print is said to be. It may not, by bent paper, another
// scale of one axis, or a lens that is not as calibrated.
#pragma once

#include <array>
#include <span>

#include "fastibl/tracking/fit_edges.h"

namespace fastibl {

// Standard deviation in x and y, px, of the places of the board's parts from where the fitted pose
// puts them, beyond what errors of their edges explain; 0 where those explain all. variance: of the
// fit by that of the edges' scatter alone, for what edges of a side share.
double board_misfit(std::span<const EdgePoint> points, const EdgeFit& fit, double variance);

}  // namespace fastibl
