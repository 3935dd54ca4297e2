#include "fastibl/scene/octahedral.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <mutex>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// Position along Hilbert's curve, the first quadrant first: Wikipedia's xy2d.
int along_curve(int size, int x, int y) {
  int position = 0;
  for (int s = size / 2; s > 0; s /= 2) {
    const int right = (x & s) > 0, up = (y & s) > 0;
    position += s * s * ((3 * right) ^ up);
    if (up) continue;
    if (right) x = size - 1 - x, y = size - 1 - y;
    std::swap(x, y);
  }
  return position;
}

FASTIBL_CLONES
void points_by_width(int count, const float* x, const float* y, const float* z, float* u,
                     float* v) {
  for (int i = 0; i < count; ++i) {
    const float ax = std::fabs(x[i]), ay = std::fabs(y[i]), az = std::fabs(z[i]);
    const float less = ax < ay ? ax : ay, more = ax < ay ? ay : ax;
    const float t = more > 0 ? less / more : 0, t2 = t * t;
    // 2/π atan t, a polynomial that is nowhere off by more than 2e-7.
    const float part =
        t * (0.63661730f +
             t2 * (-0.21210496f +
                   t2 * (0.12610048f +
                         t2 * (-0.08424609f +
                               t2 * (0.05069001f + t2 * (-0.02139311f + t2 * 0.00433652f))))));
    const float r = std::sqrt(ax * ax + ay * ay) / std::sqrt(1 + az);
    const float b = r * (ax < ay ? 1 - part : part), a = r - b;
    const bool low = z[i] < 0;
    u[i] = 0.5f + 0.5f * std::copysign(low ? 1 - b : a, x[i]);
    v[i] = 0.5f + 0.5f * std::copysign(low ? 1 - a : b, y[i]);
  }
}

}  // namespace

glm::vec2 octahedral_point(glm::vec3 d) {
  const glm::vec3 a = glm::abs(d);
  // √(1 − |z|) = √(x² + y²)/√(1 + |z|), which keeps its digits near the pole.
  const float flat = std::sqrt(a.x * a.x + a.y * a.y), r = flat / std::sqrt(1 + a.z);
  const float y = flat > 0 ? r * std::atan2(a.y, a.x) * (2 / kPi) : 0, x = r - y;
  const glm::vec2 folded = d.z < 0 ? glm::vec2(1 - y, 1 - x) : glm::vec2(x, y);
  return {0.5f + 0.5f * std::copysign(folded.x, d.x), 0.5f + 0.5f * std::copysign(folded.y, d.y)};
}

void octahedral_points(int count, const float* x, const float* y, const float* z, float* u,
                       float* v) {
  points_by_width(count, x, y, z, u, v);
}

glm::vec3 octahedral_direction(glm::vec2 point) {
  const glm::vec2 p = 2.0f * point - 1.0f, a = glm::abs(p);
  const float s = 1 - a.x - a.y, r = 1 - std::abs(s);
  const float angle = r > 0 ? ((a.y - a.x) / r + 1) * (kPi / 4) : 0;
  const float flat = r * std::sqrt(std::max(2 - r * r, 0.0f));
  return {std::copysign(flat * std::cos(angle), p.x), std::copysign(flat * std::sin(angle), p.y),
          std::copysign(1 - r * r, s)};
}

OctahedralGrid::OctahedralGrid(int size) : size_(size) {
  check(size >= 1 && size <= kLargest && std::has_single_bit(unsigned(size)),
        "a grid of the sphere must have 1, 2, 4 … ", kLargest, " cells along an edge, got ", size);
  cells_.resize(std::size_t(count())), directions_.resize(std::size_t(count()));
  neighbours_.resize(std::size_t(count()) * 8);
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x) {
      const int k = along_curve(size, x, y);
      cells_[std::size_t(y * size + x)] = std::uint16_t(k);
      directions_[std::size_t(k)] =
          octahedral_direction({(float(x) + 0.5f) / float(size), (float(y) + 0.5f) / float(size)});
    }
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x) {
      std::uint16_t* to = &neighbours_[std::size_t(cell(x, y)) * 8];
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
          if (dx != 0 || dy != 0) *to++ = std::uint16_t(cell(x + dx, y + dy));
    }
}

int OctahedralGrid::cell(int x, int y) const {
  if (x < 0 || x >= size_) x = std::clamp(x, 0, size_ - 1), y = size_ - 1 - y;
  if (y < 0 || y >= size_) y = std::clamp(y, 0, size_ - 1), x = size_ - 1 - x;
  return cells_[std::size_t(y * size_ + x)];
}

OctahedralGrid::Corners OctahedralGrid::corners(glm::vec2 point) const {
  const glm::vec2 p = float(size_) * point - 0.5f;
  const float left = std::floor(p.x), top = std::floor(p.y);
  const int x = int(left), y = int(top);
  const float u = p.x - left, v = p.y - top;
  const float shares[4] = {(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v};
  if (x >= 0 && y >= 0 && x + 1 < size_ && y + 1 < size_) {
    const std::uint16_t* at = &cells_[std::size_t(y * size_ + x)];
    return {{at[0], at[1], at[size_], at[size_ + 1]}, {shares[0], shares[1], shares[2], shares[3]}};
  }
  return {{cell(x, y), cell(x + 1, y), cell(x, y + 1), cell(x + 1, y + 1)},
          {shares[0], shares[1], shares[2], shares[3]}};
}

const OctahedralGrid& octahedral_grid(int size) {
  static std::mutex mutex;
  static std::array<std::unique_ptr<const OctahedralGrid>, 8> grids;
  check(size >= 1 && size <= OctahedralGrid::kLargest && std::has_single_bit(unsigned(size)),
        "a grid of the sphere must have 1, 2, 4 … ", OctahedralGrid::kLargest,
        " cells along an edge, got ", size);
  const std::lock_guard lock(mutex);
  auto& grid = grids[std::size_t(std::countr_zero(unsigned(size)))];
  if (!grid) grid = std::make_unique<const OctahedralGrid>(size);
  return *grid;
}

}  // namespace fastibl
