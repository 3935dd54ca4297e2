#include "fastibl/shading/sample_cells.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <utility>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

using Int4 [[gnu::vector_size(16), gnu::aligned(4)]] = std::int32_t;
// Triangles of at most so many subpixels: their edge functions fit into 32 bits.
constexpr std::int64_t kSmall = 1 << 14;

// A sample exactly on an edge belongs to one of the two triangles: the top-left rule.
bool owns_edge(const PictureCorner& a, const PictureCorner& b) {
  return a.y == b.y ? b.x > a.x : b.y < a.y;
}

// Edge functions are linear: they are stepped from pixel to pixel, with a fixed offset for each
// sample. The third is what the other two leave of the area.
template <typename Int>
struct Edges {
  Int step_x[2], step_y[2];  // by pixel
  Int start[2];              // at the corner of the first pixel
  Int offset[2][kSamples];
  Int bias[3];  // -1 where samples on the edge belong to another
  Int area;
};

template <typename Int>
FASTIBL_INLINE Edges<Int> edges_of(const PictureCorner* const (&v)[3], std::int64_t area, int x0,
                                   int y0) {
  Edges<Int> e;
  e.area = Int(area);
  for (int k = 0; k < 3; ++k) e.bias[k] = owns_edge(*v[(k + 1) % 3], *v[(k + 2) % 3]) ? 0 : -1;
  for (int k = 0; k < 2; ++k) {
    const PictureCorner &from = *v[k + 1], &to = *v[(k + 2) % 3];
    const Int dx = Int(from.y - to.y), dy = Int(to.x - from.x);
    e.step_x[k] = dx * kSubpixel, e.step_y[k] = dy * kSubpixel;
    e.start[k] = Int(edge(from, to, std::int64_t{x0} * kSubpixel, std::int64_t{y0} * kSubpixel));
    for (int s = 0; s < kSamples; ++s) e.offset[k][s] = dx * kSampleX[s] + dy * kSampleY[s];
  }
  return e;
}

// Fills the pixels [x0, x1] × [y0, y1].
template <typename Int>
FASTIBL_INLINE void fill(const SampleWindow& window, const PictureCorner* const (&v)[3],
                         std::int64_t area, int x0, int x1, int y0, int y1, int triangle) {
  using IntN [[gnu::vector_size(kSamples * sizeof(Int))]] = Int;
  const Edges<Int> e = edges_of<Int>(v, area, x0, y0);
  IntN offset0, offset1;
  for (int s = 0; s < kSamples; ++s) offset0[s] = e.offset[0][s], offset1[s] = e.offset[1][s];
  const float per_area = 1 / float(area);
  const Int4 name = {triangle, triangle, triangle, triangle};
  Int row0 = e.start[0], row1 = e.start[1];
  for (int y = y0; y <= y1; ++y, row0 += e.step_y[0], row1 += e.step_y[1]) {
    SampleCell* cell =
        window.cells + std::ptrdiff_t(y - window.top) * window.width() + (x0 - window.left);
    IntN e0 = row0 + offset0, e1 = row1 + offset1;
    for (int x = x0; x <= x1; ++x, ++cell, e0 += e.step_x[0], e1 += e.step_x[1]) {
      const IntN e2 = e.area - e0 - e1;
      const IntN outside = (e0 + e.bias[0]) | (e1 + e.bias[1]) | (e2 + e.bias[2]);
      const Float4 depth = per_area * (__builtin_convertvector(e0, Float4) * v[0]->inverse_depth +
                                       __builtin_convertvector(e1, Float4) * v[1]->inverse_depth +
                                       __builtin_convertvector(e2, Float4) * v[2]->inverse_depth);
      Float4 before;
      Int4 names;
      std::memcpy(&before, cell->inverse_depth.data(), sizeof before);
      std::memcpy(&names, cell->triangle.data(), sizeof names);
      const Int4 covers = __builtin_convertvector(outside >= 0, Int4) & (depth > before);
      before = covers ? depth : before, names = covers ? name : names;
      std::memcpy(cell->inverse_depth.data(), &before, sizeof before);
      std::memcpy(cell->triangle.data(), &names, sizeof names);
    }
  }
}

FASTIBL_CLONES
void fill_small(const SampleWindow& window, const PictureCorner* const (&v)[3], std::int64_t area,
                int x0, int x1, int y0, int y1, int triangle) {
  fill<std::int32_t>(window, v, area, x0, x1, y0, y1, triangle);
}

}  // namespace

void fill_triangle(const SampleWindow& window, const PictureCorner& a, const PictureCorner& b,
                   const PictureCorner& c, int triangle) {
  const PictureCorner* v[3] = {&a, &b, &c};
  std::int64_t area = edge(a, b, c.x, c.y);
  if (area == 0) return;
  if (area < 0) std::swap(v[1], v[2]), area = -area;
  const auto [least_x, most_x] = std::minmax({a.x, b.x, c.x});
  const auto [least_y, most_y] = std::minmax({a.y, b.y, c.y});
  // Rounded towards 0: a pixel more at the picture's left and upper edge.
  const int x0 = std::max(int(least_x / kSubpixel), window.left),
            x1 = std::min(int(most_x / kSubpixel), window.right);
  const int y0 = std::max(int(least_y / kSubpixel), window.top),
            y1 = std::min(int(most_y / kSubpixel), window.bottom);
  if (x0 > x1 || y0 > y1) return;
  if (std::max(most_x - least_x, most_y - least_y) < kSmall)
    fill_small(window, v, area, x0, x1, y0, y1, triangle);
  else
    fill<std::int64_t>(window, v, area, x0, x1, y0, y1, triangle);
}

}  // namespace fastibl
