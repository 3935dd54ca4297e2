// Interpolates what triangles show between their corners, perspective-correct.
#pragma once

#include <cstdint>
#include <span>

#include "fastibl/core/vector.h"
#include "fastibl/shading/sample_cells.h"

namespace fastibl {

// The interpolated values, marker frame.
struct Varying {
  glm::vec3 position;  // metres
  glm::vec3 normal;
  glm::vec4 share;  // shares of its irradiance (RGB) and of its glossy light that reach it
  // For a textured or anisotropic material only:
  glm::vec4 tangent;  // w: the side of n × t on which v grows
  glm::vec2 uv;
};

// A triangle of the picture, whose area is not 0.
struct DrawnTriangle {
  int name;
  glm::ivec3 corners;
  std::int64_t x, y;  // of the first corner, 1/256 pixel
  // Each corner's part in 1 / depth at the first corner, and its growth per 1/256 pixel. In double,
  // since the growths of a sliver are large and cancel.
  glm::dvec3 at_first, by_x, by_y;

  DrawnTriangle(int name, glm::ivec3 corners, const PictureCorner& a, const PictureCorner& b,
                const PictureCorner& c);
  // Weights of the corners at a point of the picture, 1/256 pixel.
  glm::vec3 shares(std::int64_t px, std::int64_t py) const {
    const glm::vec3 w(at_first + double(px - x) * by_x + double(py - y) * by_y);
    return w * (1 / (w.x + w.y + w.z));
  }
};

// The part of pixel (x, y) in which some of its samples show one triangle.
struct TrianglePart {
  int triangle;  // its place in a list
  int x, y, count;
  int px, py;  // middle of the samples from the pixel's corner, 1/256 pixel

  std::int64_t picture_x() const { return std::int64_t{x} * kSubpixel + px; }
  std::int64_t picture_y() const { return std::int64_t{y} * kSubpixel + py; }
};

// One value for each part; normals are not normalized. varyings: by corner.
void interpolate(std::span<const TrianglePart> parts, const DrawnTriangle* triangles,
                 const Varying* varyings, Varying* out);

}  // namespace fastibl
