#include "fastibl/capture/expected_error.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kLeast = 0.001;  // of a map that was seen all over: registration, footprints

}  // namespace

ErrorInterval expected_error(const MapKnowledge& known) {
  if (known.unseen_flux >= 1) return {};  // nothing was seen: nothing is known
  const double sky = std::clamp(known.unseen_sky, 0.0, 1.0);
  const double flux = std::clamp(known.unseen_flux, 0.0, 1.0);
  const double unseen = 0.36 * std::pow(sky + 0.01, 0.4) * std::pow(flux + 0.01, 1.7);
  // What is only a bound, or near, may be wrong by that much, or not at all.
  const double sure = unseen + kLeast;
  const double expected = sure + known.parallax + 0.5 * known.bound_flux;
  // Of its logarithm: the less is left unseen, the more it matters what that is.
  const double below = 1 - 0.35 * sky, above = 1 - 0.7 * sky;
  return {expected, sure * std::exp(-below), expected * std::exp(above)};
}

}  // namespace fastibl
