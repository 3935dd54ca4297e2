#include "fastibl/shadow/sky_cells.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "fastibl/core/check.h"
#include "fastibl/core/scramble.h"

namespace fastibl {
namespace {

// Lowest direction that is drawn, sine of its elevation: a shadow of 1000 times the height.
constexpr double kLowest = 1e-3;

double part(double x) { return x - std::floor(x); }

// In [0, 1).
double scrambled(std::uint32_t h) { return scramble(h) * 0x1p-32; }

}  // namespace

SkyCells::SkyCells(int rings) : rings_(rings) {
  check(rings >= 1 && rings <= 64, "rings must be 1 to 64, got ", rings);
}

int SkyCells::cell(float polar, float azimuth) const {
  const int ring = std::clamp(int(polar * float(rings_) / (0.5f * kPi)), 0, rings_ - 1);
  const int n = sectors(ring);
  const float turns = azimuth - std::floor(azimuth);
  return first(ring) + std::min(int(turns * float(n)), n - 1);
}

std::vector<glm::vec3> SkyCells::directions(int cell, int count) const {
  int ring = int(0.5 * std::sqrt(double(cell)));
  while (first(ring) > cell) --ring;
  while (first(ring + 1) <= cell) ++ring;
  const int sector = cell - first(ring);
  const double step = 0.5 * std::numbers::pi / rings_;
  const double low = std::pow(std::sin(step * ring), 2),
               high = std::pow(std::sin(step * (ring + 1)), 2);
  // A lattice of rank one (Roberts 2018, The Unreasonable Effectiveness of Quasirandom Sequences),
  // shifted by another amount in each cell, so that the gaps of neighbours do not line up.
  constexpr double kPlastic = 1.32471795724474602596;
  const double shift_u = scrambled(2 * std::uint32_t(cell) + 1),
               shift_v = scrambled(2 * std::uint32_t(cell) + 2);
  std::vector<glm::vec3> out;
  for (int k = 0; k < count; ++k) {
    const double u = part(shift_u + k / kPlastic), v = part(shift_v + (k + 0.5) / count);
    const double sine2 = low + (high - low) * v,
                 z = std::sqrt(std::max(1 - sine2, kLowest * kLowest));
    const double turn = 2 * std::numbers::pi * (sector + u) / sectors(ring),
                 s = std::sqrt(1 - z * z);
    out.push_back({float(s * std::cos(turn)), float(s * std::sin(turn)), float(z)});
  }
  return out;
}

}  // namespace fastibl
