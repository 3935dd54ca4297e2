#include "fastibl/scene/directional_albedo.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

// ρ by the midpoint rule in p = (n·h)^{s+1}, which flattens the lobe, and in azimuth:
// ρ = (s + 8)/(8π) ∫ c^s max(n·l, 0) 4 (v·h) dh, dh = dc dφ, c^s dc = dp/(s + 1).
double albedo_quadrature(double cos_view, double s) {
  constexpr int kSteps = 64, kTurns = 48;
  static const std::array<double, kTurns> turns = [] {
    std::array<double, kTurns> cosines;
    for (int k = 0; k < kTurns; ++k)
      cosines[std::size_t(k)] = std::cos((k + 0.5) / kTurns * std::numbers::pi);
    return cosines;
  }();
  const double sin_view = std::sqrt(std::max(0.0, 1 - cos_view * cos_view));
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double c = std::pow((i + 0.5) / kSteps, 1 / (s + 1)),
                 h = std::sqrt(std::max(0.0, 1 - c * c));
    for (const double turn : turns) {  // half a turn: the integrand is even in φ
      const double vh = cos_view * c + sin_view * h * turn;
      sum += std::max(0.0, vh) * std::max(0.0, 2 * vh * c - cos_view);
    }
  }
  return (s + 8) / (s + 1) * sum / (kSteps * kTurns);  // 4 · 2π / 8π = 1
}

}  // namespace

const std::vector<float>& albedo_table() {
  static const std::vector<float> table = [] {
    constexpr int n = kAlbedoTableSize;
    std::vector<float> values(std::size_t(n) * n);
    for (int row = 0; row < n; ++row)
      for (int column = 0; column < n; ++column) {
        const double q = double(row) / (n - 1), cosine = double(column) / (n - 1);
        // s → ∞: the half vector is the normal, so v·h and n·l are both cos θ_v.
        values[std::size_t(row) * n + std::size_t(column)] =
            float(row == 0 ? cosine * cosine : albedo_quadrature(cosine, 8 / (q * q) - 8));
      }
    return values;
  }();
  return table;
}

float directional_albedo(float cos_view, float exponent) {
  constexpr int n = kAlbedoTableSize;
  const std::vector<float>& table = albedo_table();
  const float x = cos_view > 0 ? std::min(cos_view, 1.0f) * (n - 1) : 0;  // NaN, too, is a place
  const float y = shared::albedo_coordinate(exponent) * (n - 1);
  const int ix = std::min(int(x), n - 2), iy = std::min(int(y), n - 2);
  const float fx = x - float(ix), fy = y - float(iy);
  const float* a = &table[std::size_t(iy) * n + std::size_t(ix)];
  const float upper = a[0] + fx * (a[1] - a[0]), lower = a[n] + fx * (a[n + 1] - a[n]);
  return upper + fy * (lower - upper);
}

float albedo_scale(Normalization normalization, float s) {
  if (normalization != Normalization::exact) return 1;
  if (!(s > 1)) return (s + 2) * (s + 4) / ((s + 8) * (std::exp2(-s / 2) + s));
  return (1 + 2 / s) * (1 + 4 / s) / ((1 + 8 / s) * (1 + std::exp2(-s / 2) / s));  // 1 at s = ∞
}

}  // namespace fastibl
