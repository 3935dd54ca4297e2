// Finds which triangle each of a pixel's four samples shows, by edge functions in fixed point.
#pragma once

#include <array>
#include <cstdint>

namespace fastibl {

// Positions snap to 1/256 pixel and the four samples lie where GPUs put them, so that the GL back
// end covers the same samples.
inline constexpr int kSubpixel = 256;
inline constexpr int kSamples = 4;
inline constexpr int kSampleX[kSamples] = {96, 224, 32, 160},
                     kSampleY[kSamples] = {32, 96, 160, 224};

// A vertex in the picture.
struct PictureCorner {
  std::int64_t x = 0, y = 0;  // 1/256 pixel, up to 2^29
  float inverse_depth = 0;    // 1 / m
  bool valid = false;
};

// Twice the signed area of (a, b, p); positive on one side of the edge.
inline std::int64_t edge(const PictureCorner& a, const PictureCorner& b, std::int64_t px,
                         std::int64_t py) {
  return (b.x - a.x) * (py - a.y) - (b.y - a.y) * (px - a.x);
}

struct SampleCell {
  std::array<float, kSamples> inverse_depth{};  // 0: nothing
  std::array<std::int32_t, kSamples> triangle{-1, -1, -1, -1};
};

// Cells of the pixels [left, right] × [top, bottom], row by row.
struct SampleWindow {
  SampleCell* cells;
  int left, top, right, bottom;
  int width() const { return right - left + 1; }
};

// Gives the triangle the samples that it covers and at which it is nearer than what is there.
// Neighbours share no sample of their common edge, and leave none out.
void fill_triangle(const SampleWindow& window, const PictureCorner& a, const PictureCorner& b,
                   const PictureCorner& c, int triangle);

}  // namespace fastibl
