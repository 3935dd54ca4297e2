// How a MIP level is made from the next finer one: solid-angle means.
#pragma once

#include <memory>
#include <vector>

#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

class CubeLevel;

// The weights from faces of n texels to faces of max(1, n / 2); the same for all faces.
class CubeReduction {
 public:
  // Reductions are kept for the sizes in use, so that the arctangents are computed once.
  static std::shared_ptr<const CubeReduction> of(int size);
  explicit CubeReduction(int size);

  // For a factor of 2 only: the share of a fine texel of a face in its coarse one, which is
  // (u₀ w + l₀ w) + (u₁ w + l₁ w) of the upper and the lower fine texels.
  float share(int x, int y) const {
    const std::vector<float>& weights = y & 1 ? lower_weights_ : upper_weights_;
    const std::size_t coarse = std::size_t(y / 2) * std::size_t(coarse_) + std::size_t(x / 2);
    return weights[6 * coarse + 3 * std::size_t(x & 1)];
  }

  // The texels of the coarse level that read any of these texels of the fine level.
  FaceRect reached(const FaceRect& fine) const;
  // Makes these texels of the coarse level, with the same bits whatever other texels are made in
  // the same call.
  void reduce(const CubeLevel& fine, const FaceRect& of_coarse, CubeLevel& coarse) const;

 private:
  // One axis of a reduction by a factor other than 2: source texels [first, first + weights).
  struct Overlap {
    int first;
    std::vector<double> weights;
  };
  int fine_, coarse_;
  // For a factor of 2, row by row: of two fine texels for each coarse one, repeated by channel.
  std::vector<float> upper_weights_, lower_weights_;
  std::vector<double> angles_;  // for another factor: solid angles of the fine texels
  std::vector<Overlap> spans_;
};

}  // namespace fastibl
