// Sums of a cube level under a round lobe around every texel.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

// The six faces side by side, each with a margin of its neighbours' texels, so that the
// surroundings of a texel are read in rows: texel (x, y) of all faces is one block of 24 floats,
// face by face, the last six unused.
class PaddedFaces {
 public:
  static constexpr int kBlock = 24;
  explicit PaddedFaces(const CubeLevel& level);
  int size() const { return size_; }
  static int margin(int size) { return size < 12 ? size : 12; }
  const float* blocks() const { return blocks_.data(); }

 private:
  int size_;
  std::vector<float> blocks_;
};

// Weights of the lobe ((1 + cos δ)/2)^{e/2} cos δ times the solid angles of the texels, summing to
// 1, for the texels of one face, since all faces of the cube are alike. Texels beyond 3.3 standard
// deviations are left out (0.4 % of the lobe).
class LobeFilter {
 public:
  LobeFilter(int size, float exponent);
  CubeLevel operator()(const PaddedFaces& source) const;

 private:
  struct Run {
    std::int32_t first, count;  // blocks of PaddedFaces
  };
  int size_;
  std::vector<std::int32_t> begin_;  // first of each texel's runs; one more at the end
  std::vector<std::int32_t> weight_begin_;
  std::vector<Run> runs_;
  std::vector<float> weights_;
};

// The same for few texels and lobes as wide as the sphere: every texel of the source counts.
class WideLobeFilter {
 public:
  WideLobeFilter(int source_size, int size, float exponent);
  CubeLevel operator()(const CubeLevel& source) const;

 private:
  int source_size_, size_;
  std::vector<float> weights_;  // of all source texels, for each target texel
};

}  // namespace fastibl
