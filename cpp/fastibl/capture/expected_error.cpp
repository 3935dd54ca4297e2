#include "fastibl/capture/expected_error.h"

#include <algorithm>
#include <cmath>

namespace fastibl {

ErrorInterval expected_error(const MapKnowledge& known) {
  const double sky = std::max(known.unseen_sky, 0.0), flux = std::max(known.unseen_flux, 0.0);
  const double expected = 0.6 * std::pow(sky + 0.01, 0.41) * std::pow(flux + 0.01, 1.7) + 0.001 +
                          known.parallax + 0.5 * known.bound_flux;
  return {expected, expected / 3, expected * 2.7};
}

}  // namespace fastibl
