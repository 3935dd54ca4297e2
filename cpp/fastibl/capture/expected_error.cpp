#include "fastibl/capture/expected_error.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kLeast = 0.001;  // of a map that was seen all over: registration, footprints
constexpr double kBound = 0.5;    // of what is only a bound
// kWeighed: the same where it was made as bright as the plane says. kBoosted: of the square of what
// that added, as one reading does not tell where the light comes from. Fitted to films with one
// exposure of the four places; see ./dev goals capture --only boost.
constexpr double kWeighed = 0.2, kBoosted = 0.25;
// Of the error that near things may cause beyond what is expected of them: in the upper end alone.
constexpr double kDoubts = 0.8;
constexpr double kLeastOfBounds = 0.2, kMostOfBounds = 2.5;  // times that: the interval's ends

}  // namespace

ErrorInterval expected_error(const MapKnowledge& known) {
  if (known.unseen_flux >= 1) return {};  // nothing was seen: nothing is known
  const double sky = std::clamp(known.unseen_sky, 0.0, 1.0);
  const double flux = std::clamp(known.unseen_flux, 0.0, 1.0);
  const double unseen = 0.36 * std::pow(sky + 0.01, 0.4) * std::pow(flux + 0.01, 1.7);
  // What is only a bound, or near, may be wrong by that much, or not at all.
  const double sure = unseen + kLeast;
  const double boosted = known.boosted_flux * known.boosted_flux,
               bounds = known.weighed ? kWeighed * known.bound_flux + kBoosted * boosted
                                      : kBound * known.bound_flux;
  const double open = sure + known.parallax + known.scale, expected = open + bounds;
  const double doubt = kDoubts * known.parallax_doubt;
  // Spread of its logarithm: the less is unseen, the more it matters what that is.
  const double below = 1.1 - 0.5 * sky, above = 0.9 - 0.57 * sky;
  if (!known.weighed)
    return {expected, sure * std::exp(-below), expected * std::exp(above) + doubt};
  return {expected, sure * std::exp(-below) + kLeastOfBounds * bounds,
          open * std::exp(above) + kMostOfBounds * bounds + doubt};
}

}  // namespace fastibl
