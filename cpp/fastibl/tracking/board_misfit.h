// Whether a board lies where its print is said to be: bent paper, another scale of one axis, a lens
// that is not as calibrated.
#pragma once

#include <array>
#include <span>

#include "fastibl/tracking/fit_edges.h"

namespace fastibl {

// Standard deviation in x and y, px, of the place of a part of the board about where the fitted
// pose puts it, beyond what the scatter of its edges explains; 0 where that explains all.
double board_misfit(std::span<const EdgePoint> points, const EdgeFit& fit);

}  // namespace fastibl
