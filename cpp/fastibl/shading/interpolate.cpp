#include "fastibl/shading/interpolate.h"

#include <cstddef>
#include <cstring>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// Interpolates all sixteen numbers of a corner at once.
FASTIBL_CLONES
void interpolate(const TrianglePart* parts, std::size_t count, const DrawnTriangle* triangles,
                 const Varying* varyings, Varying* out) {
  static_assert(sizeof(Varying) == sizeof(Float16));
  for (std::size_t i = 0; i < count; ++i) {
    const TrianglePart& part = parts[i];
    const DrawnTriangle& t = triangles[part.triangle];
    const double x = double(part.picture_x() - t.x), y = double(part.picture_y() - t.y);
    float w[3];
    for (int k = 0; k < 3; ++k)
      w[k] = float((&t.at_first.x)[k] + x * (&t.by_x.x)[k] + y * (&t.by_y.x)[k]);
    const float all = 1 / (w[0] + w[1] + w[2]);
    Float16 at[3];
    for (int k = 0; k < 3; ++k) std::memcpy(&at[k], varyings + (&t.corners.x)[k], sizeof at[k]);
    const Float16 mean = (all * w[0]) * at[0] + (all * w[1]) * at[1] + (all * w[2]) * at[2];
    std::memcpy(static_cast<void*>(out + i), &mean, sizeof mean);
  }
}

}  // namespace

DrawnTriangle::DrawnTriangle(int triangle, glm::ivec3 indices, const PictureCorner& a,
                             const PictureCorner& b, const PictureCorner& c)
    : name(triangle), corners(indices), x(a.x), y(a.y), at_first(a.inverse_depth, 0, 0) {
  // Edge functions divided by the area: 1 at a corner, 0 along the edge that faces it.
  const glm::dvec3 scale =
      glm::dvec3(a.inverse_depth, b.inverse_depth, c.inverse_depth) / double(edge(a, b, c.x, c.y));
  by_x = scale * glm::dvec3(b.y - c.y, c.y - a.y, a.y - b.y);
  by_y = scale * glm::dvec3(c.x - b.x, a.x - c.x, b.x - a.x);
}

void interpolate(std::span<const TrianglePart> parts, const DrawnTriangle* triangles,
                 const Varying* varyings, Varying* out) {
  interpolate(parts.data(), parts.size(), triangles, varyings, out);
}

}  // namespace fastibl
