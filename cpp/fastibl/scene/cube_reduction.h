// How a MIP level is made of the one above: solid-angle means.
#pragma once

#include <memory>
#include <vector>

#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

class CubeLevel;

// The weights from faces of n texels to faces of max(1, n / 2); the same for all faces.
class CubeReduction {
 public:
  // Kept for the sizes in use: the arctangents are worked out once.
  static std::shared_ptr<const CubeReduction> of(int size);
  explicit CubeReduction(int size);

  // Whether by factor 2; if so, the share of a fine texel of a face in its coarse one, which is
  // (u₀ w + l₀ w) + (u₁ w + l₁ w) of the upper and lower ones.
  float share(int x, int y) const {
    const std::vector<float>& weights = y & 1 ? lower_weights_ : upper_weights_;
    const std::size_t coarse = std::size_t(y / 2) * std::size_t(coarse_) + std::size_t(x / 2);
    return weights[6 * coarse + 3 * std::size_t(x & 1)];
  }

  // The texels of the coarse level that read any of these of the fine one.
  FaceRect reached(const FaceRect& fine) const;
  // Makes these texels of the coarse level. The same bits whatever else is made with them.
  void reduce(const CubeLevel& fine, const FaceRect& of_coarse, CubeLevel& coarse) const;

 private:
  // One axis of a reduction by another factor than 2: source texels [first, first + weights).
  struct Overlap {
    int first;
    std::vector<double> weights;
  };
  int fine_, coarse_;
  // By factor 2, row by row: of two texels a coarse one, once for each channel.
  std::vector<float> upper_weights_, lower_weights_;
  std::vector<double> angles_;  // by another factor: of the fine texels
  std::vector<Overlap> spans_;
};

}  // namespace fastibl
