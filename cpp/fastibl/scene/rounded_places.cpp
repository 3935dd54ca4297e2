#include "fastibl/scene/rounded_places.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastibl {

glm::dvec3 offset_before_rounding(glm::dvec3 lower, glm::dvec3 upper) {
  constexpr double kRounding = 0x1p-24, kMostLost = 1e-4;
  double size = 0, away = 0;
  for (int k = 0; k < 3; ++k) {
    size = std::max(size, upper[k] - lower[k]);
    away = std::max({away, std::abs(lower[k]), std::abs(upper[k])});
  }
  const bool is_finite = away < std::numeric_limits<double>::infinity();
  if (!(size > 0) || !is_finite || !(kRounding * away > kMostLost * size)) return glm::dvec3(0);
  const double decimals = std::clamp(-std::floor(std::log10(size)), 0.0, 15.0);
  const double scale = std::pow(10.0, decimals);
  return glm::round(scale * 0.5 * (lower + upper)) / scale;
}

}  // namespace fastibl
