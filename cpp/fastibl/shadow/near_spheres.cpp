#include "fastibl/shadow/near_spheres.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastibl {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Span {
  double low = kInfinity, high = -kInfinity;
};

// The numbers where a x² + 2 b x + c ≥ 0: at most two spans.
int where_positive(double a, double b, double c, Span (&spans)[2]) {
  const double root2 = b * b - a * c;
  if (a < 0) {
    if (!(root2 > 0)) return 0;
    const double root = std::sqrt(root2);
    spans[0] = {(-b + root) / a, (-b - root) / a};
    return 1;
  }
  if (!(root2 > 0)) {
    spans[0] = {-kInfinity, kInfinity};
    return 1;
  }
  if (a == 0) {
    const double at = -c / (2 * b);
    spans[0] = b > 0 ? Span{at, kInfinity} : Span{-kInfinity, at};
    return 1;
  }
  const double root = std::sqrt(root2);
  spans[0] = {-kInfinity, (-b - root) / a}, spans[1] = {(-b + root) / a, kInfinity};
  return 2;
}

// Sets the texels whose centres, at whole numbers, lie in a span.
void set_span(int row, double low, double high, PlaneBits& bits) {
  const double size = bits.size();
  const int begin = int(std::ceil(std::clamp(low, 0.0, size))),
            end = int(std::ceil(std::clamp(high, 0.0, size)));
  if (begin < end) bits.set_span(row, begin, end);
}

// A point q = p + u sees the light p past a sphere, whose centre is p + m, unless the ray lies in
// the cone of tangents, (m·u)² ≥ K |u|² with K = |m|² − r², and q lies behind the plane of the
// points where the tangents touch, m·u ≥ K. All in texels.
struct Cone {
  glm::dvec3 light, m;
  double r, k;

  Cone(const glm::dvec3& p, const glm::dvec3& centre, double radius)
      : light(p), m(centre - p), r(radius), k(glm::dot(m, m) - radius * radius) {}

  // Rows that the shadow can reach, seen along x: those of the cone from the light around a disc.
  Span rows() const {
    const double k2 = m.y * m.y + m.z * m.z - r * r, z = -light.z;
    Span spans[2];
    if (!(-m.z > r) || !(k2 > 0)) return {-kInfinity, kInfinity};
    if (where_positive(m.y * m.y - k2, m.y * m.z * z, (m.z * m.z - k2) * z * z, spans) != 1)
      return {-kInfinity, kInfinity};
    return {light.y + spans[0].low, light.y + spans[0].high};
  }

  void set_row(int row, PlaneBits& bits) const {
    const double y = row - light.y, z = -light.z, g = m.y * y + m.z * z;
    Span behind{-kInfinity, kInfinity}, spans[2];
    if (m.x > 0)
      behind.low = (k - g) / m.x;
    else if (m.x < 0)
      behind.high = (k - g) / m.x;
    else if (g < k)
      return;
    const int count = where_positive(m.x * m.x - k, m.x * g, g * g - k * (y * y + z * z), spans);
    for (int i = 0; i < count; ++i)
      set_span(row, light.x + std::max(spans[i].low, behind.low),
               light.x + std::min(spans[i].high, behind.high), bits);
  }
};

// A sphere that the plane cuts: points on its disc lie in it.
void add_disc(const glm::dvec3& centre, double radius, PlaneBits& bits) {
  const double r2 = (radius - centre.z) * (radius + centre.z);
  if (!(r2 > 0)) return;
  const double size = bits.size(), r = std::sqrt(r2);
  const int begin = int(std::ceil(std::clamp(centre.y - r, 0.0, size))),
            end = int(std::ceil(std::clamp(centre.y + r, 0.0, size)));
  for (int row = begin; row < end; ++row) {
    const double half = std::sqrt(std::max(r2 - (row - centre.y) * (row - centre.y), 0.0));
    set_span(row, centre.x - half, centre.x + half, bits);
  }
}

}  // namespace

void add_near_shadow(const SphereSet& spheres, const glm::dvec3& light, const PlaneGrid& grid,
                     PlaneBits& bits) {
  const double scale = 1 / grid.texel(), size = bits.size();
  const glm::dvec3 p(grid.texels(glm::dvec2(light)), light.z * scale);
  for (const glm::vec4& s : spheres) {
    if (!is_sphere(s) || !(double(s.z) + double(s.w) > 0)) continue;
    const glm::dvec3 centre(grid.texels({s.x, s.y}), s.z * scale);
    const double radius = s.w * scale;
    const Cone cone(p, centre, radius);
    if (!(cone.k > 0)) {  // the sphere is around the light
      for (int row = 0; row < bits.size(); ++row) bits.set_span(row, 0, bits.size());
      return;
    }
    const Span rows = cone.rows();
    const int begin = int(std::ceil(std::clamp(rows.low, 0.0, size))),
              end = int(std::ceil(std::clamp(rows.high, 0.0, size)));
    for (int row = begin; row < end; ++row) cone.set_row(row, bits);
    add_disc(centre, radius, bits);
  }
}

}  // namespace fastibl
