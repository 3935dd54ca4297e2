#include "fastibl/capture/tile_pyramids.h"

#include <bit>

#include "fastibl/core/simd.h"
#include "fastibl/scene/cube_reduction.h"

namespace fastibl {
namespace {

// Halves two rows of 16 texels to a row of 8, twice.
FASTIBL_INLINE void halve_rows_of_16(const float* fine, const float* weights, float* coarse) {
  const auto at = [&](int i) {
    return *reinterpret_cast<const Float16*>(fine + i) *
           *reinterpret_cast<const Float16*>(weights + i);
  };
  const Float16 a = at(0) + at(16), b = at(32) + at(48);
  *reinterpret_cast<Float16*>(coarse) =
      __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30) +
      __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
}

// Halves four rows of 8 texels to two of 4.
FASTIBL_INLINE void halve_rows_of_8(const float* fine, const float* weights, float* coarse) {
  const auto at = [&](int i) {
    return *reinterpret_cast<const Float8*>(fine + i) *
           *reinterpret_cast<const Float8*>(weights + i);
  };
  const Float8 a = at(0) + at(8), b = at(16) + at(24);
  *reinterpret_cast<Float8*>(coarse) = __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14) +
                                       __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15);
}

FASTIBL_CLONES void make_levels(const float* fine, const float* weights, int width,
                                float* __restrict coarse) {
  for (int w = width; w > 1; w /= 2) {
    if (w == 16) {
      for (int y = 0; y < 4; ++y)
        halve_rows_of_16(fine + 64 * y, weights + 64 * y, coarse + 16 * y);
    } else if (w == 8) {
      for (int y = 0; y < 2; ++y) halve_rows_of_8(fine + 32 * y, weights + 32 * y, coarse + 8 * y);
    } else {
      float* out = coarse;
      for (int y = 0; y < w; y += 2) {
        const float *u = fine + y * w, *l = u + w, *wu = weights + y * w, *wl = wu + w;
        for (int x = 0; x < w; x += 2)
          *out++ = (u[x] * wu[x] + l[x] * wl[x]) + (u[x + 1] * wu[x + 1] + l[x + 1] * wl[x + 1]);
      }
    }
    fine = coarse, weights += w * w, coarse += w / 2 * (w / 2);
  }
}

}  // namespace

int TilePyramids::width_of(TileGrid grid) {
  const bool halves =
      grid.per_edge() == TileGrid::kMost && std::has_single_bit(unsigned(grid.size));
  return halves ? grid.widest() : 0;
}

TilePyramids::TilePyramids(TileGrid grid) : grid_(grid), starts_(1, 0) {
  const int width = width_of(grid);
  if (width == 0) return;
  const auto rounded = [](std::size_t n) { return (n + 15) / 16 * 16; };
  for (int w = width; w > 1; w /= 2, ++levels_) {
    starts_.push_back(stride_);
    weight_stride_ += std::size_t(w) * std::size_t(w);
    stride_ += std::size_t(w / 2) * std::size_t(w / 2);
  }
  stride_ = rounded(stride_), weight_stride_ = rounded(weight_stride_);
  for (auto& values : values_) values.assign(std::size_t(grid.count()) * stride_, 0.0f);
  weights_.assign(std::size_t(grid.per_face()) * weight_stride_, 0.0f);
  std::size_t start = 0;
  for (int k = 0, size = grid.size; k + 1 < levels_; ++k, size /= 2) {
    const auto reduction = CubeReduction::of(size);
    const int w = width >> k;
    for (int tile = 0; tile < grid.per_face(); ++tile) {
      const int x0 = tile % grid.per_edge() * w, y0 = tile / grid.per_edge() * w;
      float* out = &weights_[std::size_t(tile) * weight_stride_ + start];
      for (int y = 0; y < w; ++y)
        for (int x = 0; x < w; ++x) *out++ = reduction->share(x0 + x, y0 + y);
    }
    start += std::size_t(w) * std::size_t(w);
  }
}

void TilePyramids::make(int tile, const float* const fine[3]) {
  if (levels_ == 1) return;
  const float* weights = &weights_[std::size_t(tile % grid_.per_face()) * weight_stride_];
  for (int c = 0; c < 3; ++c)
    make_levels(fine[c], weights, grid_.widest(), &values_[c][std::size_t(tile) * stride_]);
}

}  // namespace fastibl
