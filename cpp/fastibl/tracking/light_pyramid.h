// The green light of a picture at several sizes. Green alone is a third of the work, and every
// camera has most of its pixels there.
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "fastibl/scene/picture.h"

namespace fastibl {

// Means over blocks of pixels, linear (exposure included). A block that holds a clipped pixel has a
// value above 1.
class LightPyramid {
 public:
  static constexpr int kFirstBlock = 2;  // pixels along a block of level 0, doubled at each level
  static constexpr int kLevels = 5;

  struct Level {
    int width = 0, height = 0, block = 0;
    std::vector<float> light;
  };

  // Keeps its memory from picture to picture.
  void make(const Picture& picture, const Response& response);
  const Level& level(int k) const { return levels_[std::size_t(k)]; }
  // The light at a pixel position, bilinear; above 1 where a clipped pixel takes part, negative
  // outside of the centres of blocks.
  float read(int k, float x, float y) const {
    const Level& l = levels_[std::size_t(k)];
    const float u = x / float(l.block) - 0.5f, v = y / float(l.block) - 0.5f;
    const int i = int(std::floor(u)), j = int(std::floor(v));
    if (!(u >= 0 && v >= 0 && i + 1 < l.width && j + 1 < l.height)) return -1;
    const float* p = &l.light[std::size_t(j) * std::size_t(l.width) + std::size_t(i)];
    const float a = u - float(i), b = v - float(j);
    const float top = p[0] + a * (p[1] - p[0]);
    const float below = p[l.width] + a * (p[l.width + 1] - p[l.width]);
    return top + b * (below - top);
  }

 private:
  void make_first(const Picture& picture, const Response& response);
  void halve(int k);
  std::array<Level, kLevels> levels_;
  std::array<float, 256> table_{};  // a quarter of the linear value, for blocks of 2 x 2
  Response table_response_;
  bool has_table_ = false;
};

}  // namespace fastibl
