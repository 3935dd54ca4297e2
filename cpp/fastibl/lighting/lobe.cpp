#include "fastibl/lighting/lobe.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "fastibl/scene/methods.h"

namespace fastibl {

std::string_view name(LobeModel model) {
  switch (model) {
    case LobeModel::phong:
      return "phong";
    case LobeModel::blinn:
      return "blinn";
    default:
      return "ggx";
  }
}

LobeModel lobe_model(std::string_view text) {
  return method_named(text, std::array{LobeModel::ggx, LobeModel::phong, LobeModel::blinn},
                      "lobe model");
}

double Lobe::operator()(double t) const {
  if (t >= 1) return 0;
  switch (model) {
    case LobeModel::phong:
      return std::exp(parameter * std::log1p(-t));
    case LobeModel::blinn:  // cos²(θ/2) = 1 − t/2
      return std::exp(0.5 * parameter * std::log1p(-t / 2)) * (1 - t);
    default: {
      // D ∝ 1/(cos²(θ/2) (α² − 1) + 1)², and cos²(θ/2) = 1 − t/2. Walter et al. 2007, Microfacet
      // Models for Refraction through Rough Surfaces, Eq. 33.
      const double a = parameter * parameter, d = a / (a + t / 2 * (1 - a));
      return d * d * (1 - t);
    }
  }
}

double Lobe::half_height() const {
  switch (model) {
    case LobeModel::phong:
      return std::min(1.0, 0.7 / (parameter + 1e-3));
    case LobeModel::blinn:
      return std::min(1.0, 2.8 / (parameter + 1e-3));
    default:
      return std::min(1.0, 0.83 * parameter * parameter);
  }
}

LobeTable::LobeTable(const Lobe& lobe) {
  const int n = int(std::clamp(32 / std::sqrt(lobe.half_height()), 256.0, 65536.0));
  steps = float(n);
  height.resize(std::size_t(n) + 1);
  slope.resize(std::size_t(n) + 1);
  integral = 0;
  for (int i = 0; i <= n; ++i) {
    const double r = double(i) / n;
    height[std::size_t(i)] = float(lobe(r * r));
    // dω = 2π dt = 4π r dr, at midpoints.
    if (i < n)
      integral += 4 * std::numbers::pi * (r + 0.5 / n) / n * lobe((r + 0.5 / n) * (r + 0.5 / n));
    const double above = lobe((r + 0.5 / n) * (r + 0.5 / n));
    const double below = i > 0 ? lobe((r - 0.5 / n) * (r - 0.5 / n)) : above;
    // r = √2 sin(θ/2), so dr/dθ = cos(θ/2)/√2.
    slope[std::size_t(i)] = float((below - above) * n * std::sqrt(std::max(0.0, 0.5 - r * r / 4)));
  }
  steepest = int(std::max_element(slope.begin(), slope.end()) - slope.begin());
}

}  // namespace fastibl
