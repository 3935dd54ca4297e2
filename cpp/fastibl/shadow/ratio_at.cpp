#include "fastibl/shadow/ratio_at.h"

#include <cmath>

#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kPoints = 64;  // worked on together

struct Direction {
  double x, y, z;
  std::int32_t share[3];
};

// Points that a direction does not reach get a 1: their ray to the light passes through a sphere,
// or starts in one. The formula is that of plane_bits.cpp, and the sums keep their digits near the
// edge.
FASTIBL_INLINE void hide(const glm::dvec4& s, const Direction& d, const double* px,
                         const double* py, std::int64_t* hidden) {
  const double u = s.x - s.z * (d.x / d.z), v = s.y - s.z * (d.y / d.z);
  const double a = d.y * d.y + d.z * d.z, b = 2 * d.x * d.y, c = d.x * d.x + d.z * d.z;
  const double r2 = s.w * s.w, front = s.z / d.z, disc2 = (s.w - s.z) * (s.w + s.z);
  for (int i = 0; i < kPoints; ++i) {
    const double x = px[i] - u, y = py[i] - v;
    const bool in_ellipse = a * x * x + c * y * y - b * x * y < r2;
    const bool before = front - x * d.x - y * d.y > 0;
    const double ox = px[i] - s.x, oy = py[i] - s.y;
    const bool inside = ox * ox + oy * oy < disc2;
    hidden[i] |= std::int64_t((in_ellipse & before) | inside);
  }
}

FASTIBL_CLONES
void lost_shares(const glm::dvec4* spheres, int sphere_count, const Direction* directions,
                 int direction_count, const double* px, const double* py, std::int32_t* lost) {
  for (int k = 0; k < direction_count; ++k) {
    std::int64_t hidden[kPoints] = {};
    for (int s = 0; s < sphere_count; ++s) hide(spheres[s], directions[k], px, py, hidden);
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < kPoints; ++i)
        lost[c * kPoints + i] += hidden[i] != 0 ? directions[k].share[c] : 0;
  }
}

}  // namespace

std::vector<glm::vec3> ratio_at(std::span<const glm::vec2> points, const SphereSet& spheres,
                                std::span<const LightDirection> light) {
  std::vector<glm::dvec4> casters;
  for (const glm::vec4& s : spheres)
    if (is_sphere(s) && double(s.z) + double(s.w) > 0) casters.emplace_back(s);
  const std::vector<glm::ivec4> shares = whole_shares(light);
  std::vector<Direction> directions;
  for (std::size_t k = 0; k < light.size(); ++k) {
    const glm::dvec3 d = glm::normalize(glm::dvec3(light[k].direction));
    directions.push_back({d.x, d.y, d.z, {shares[k].x, shares[k].y, shares[k].z}});
  }
  std::vector<glm::vec3> ratios(points.size(), glm::vec3(1));
  parallel_for(int(points.size()), kPoints, [&](int begin, int end) {
    double px[kPoints] = {}, py[kPoints] = {};
    const auto somewhere = [&](int i) {
      return std::isfinite(points[std::size_t(i)].x) && std::isfinite(points[std::size_t(i)].y);
    };
    for (int i = begin; i < end; ++i)
      if (somewhere(i))
        px[i - begin] = points[std::size_t(i)].x, py[i - begin] = points[std::size_t(i)].y;
    std::int32_t lost[3 * kPoints] = {};
    lost_shares(casters.data(), int(casters.size()), directions.data(), int(directions.size()), px,
                py, lost);
    for (int i = begin; i < end; ++i)
      for (int c = 0; c < 3 && somewhere(i); ++c)
        ratios[std::size_t(i)][c] = remaining(lost[c * kPoints + i - begin]);
  });
  return ratios;
}

}  // namespace fastibl
