#include "fastibl/scene/cube_reduction.h"

#include <cmath>
#include <cstddef>
#include <map>
#include <mutex>

#include "fastibl/core/simd.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {
namespace {

// Each coarse texel has two texels in `upper`, in `lower` and in their weights: it is w_u u + w_l l
// of the left pair, plus that of the right pair.
FASTIBL_CLONES void reduce_row(const float* upper, const float* lower, const float* upper_weights,
                               const float* lower_weights, int count, float* out) {
  const float *u = upper, *l = lower, *wu = upper_weights, *wl = lower_weights;
  int x = 0;
  for (; x + 4 <= count; x += 4, u += 24, l += 24, wu += 24, wl += 24, out += 12) {
    const Float8 a =
        floats_at<Float8>(u) * floats_at<Float8>(wu) + floats_at<Float8>(l) * floats_at<Float8>(wl);
    const Float8 b = floats_at<Float8>(u + 8) * floats_at<Float8>(wu + 8) +
                     floats_at<Float8>(l + 8) * floats_at<Float8>(wl + 8);
    const Float8 c = floats_at<Float8>(u + 16) * floats_at<Float8>(wu + 16) +
                     floats_at<Float8>(l + 16) * floats_at<Float8>(wl + 16);
    const Float8 left = __builtin_shufflevector(a, b, 0, 1, 2, 6, 7, 8, 12, 13);
    const Float8 some = __builtin_shufflevector(a, b, 3, 4, 5, 9, 10, 11, 15, 15);
    const Float8 right = __builtin_shufflevector(some, c, 0, 1, 2, 3, 4, 5, 6, 8);
    *reinterpret_cast<Float8*>(out) = left + right;
    const Float8 last = __builtin_shufflevector(b, c, 6, 10, 11, 12, 0, 0, 0, 0) +
                        __builtin_shufflevector(c, c, 1, 5, 6, 7, 0, 0, 0, 0);
    *reinterpret_cast<Float4*>(out + 8) = __builtin_shufflevector(last, last, 0, 1, 2, 3);
  }
  for (; x < count; ++x, u += 6, l += 6, wu += 6, wl += 6, out += 3)
    for (int c = 0; c < 3; ++c)
      out[c] = (u[c] * wu[c] + l[c] * wl[c]) + (u[3 + c] * wu[3 + c] + l[3 + c] * wl[3 + c]);
}

}  // namespace

std::shared_ptr<const CubeReduction> CubeReduction::of(int size) {
  static std::mutex mutex;
  static std::map<int, std::weak_ptr<const CubeReduction>> made;
  // Common sizes stay; others last as long as a map that uses them.
  static std::map<int, std::shared_ptr<const CubeReduction>> common;
  const std::lock_guard lock(mutex);
  std::weak_ptr<const CubeReduction>& known = made[size];
  std::shared_ptr<const CubeReduction> reduction = known.lock();
  if (reduction) return reduction;
  known = reduction = std::make_shared<const CubeReduction>(size);
  if (size <= 1024 && (size & (size - 1)) == 0) common[size] = reduction;
  return reduction;
}

CubeReduction::CubeReduction(int size) : fine_(size), coarse_(std::max(1, size / 2)) {
  const int n = fine_, m = coarse_;
  std::vector<double> angle = texel_solid_angles(n);
  if (n == 2 * m) {
    upper_weights_.resize(std::size_t(m) * std::size_t(m) * 6);
    lower_weights_.resize(upper_weights_.size());
    for (std::size_t y = 0, i = 0; y < std::size_t(m); ++y)
      for (std::size_t x = 0; x < std::size_t(m); ++x, i += 6) {
        const double* a = &angle[2 * y * std::size_t(n) + 2 * x];
        const double sum = a[0] + a[1] + a[n] + a[n + 1];
        for (std::size_t k = 0; k < 6; ++k) {
          upper_weights_[i + k] = float(a[k / 3] / sum);
          lower_weights_[i + k] = float(a[std::size_t(n) + k / 3] / sum);
        }
      }
    return;
  }
  angles_ = std::move(angle);
  for (int i = 0; i < m; ++i) {
    const double begin = double(i) * n / m, end = double(i + 1) * n / m;
    Overlap o{int(std::floor(begin)), {}};
    for (int k = o.first; k < n && k < end; ++k)
      o.weights.push_back(std::min(end, k + 1.0) - std::max(begin, double(k)));
    spans_.push_back(std::move(o));
  }
}

FaceRect CubeReduction::reached(const FaceRect& fine) const {
  const auto down = [&](int i) { return int(std::int64_t(i) * coarse_ / fine_); };
  const auto up = [&](int i) {
    return int((std::int64_t(i) * coarse_ + fine_ - 1) / std::max(1, fine_));
  };
  return {fine.face, down(fine.x0), down(fine.y0), up(fine.x1), up(fine.y1)};
}

void CubeReduction::reduce(const CubeLevel& fine, const FaceRect& r, CubeLevel& coarse) const {
  if (!upper_weights_.empty()) {
    for (int y = r.y0; y < r.y1; ++y) {
      const std::size_t w = (std::size_t(y) * std::size_t(coarse_) + std::size_t(r.x0)) * 6;
      reduce_row(&fine.texel(r.face, 2 * r.x0, 2 * y).x, &fine.texel(r.face, 2 * r.x0, 2 * y + 1).x,
                 &upper_weights_[w], &lower_weights_[w], r.x1 - r.x0,
                 &coarse.texel(r.face, r.x0, y).x);
    }
    return;
  }
  for (int y = r.y0; y < r.y1; ++y)
    for (int x = r.x0; x < r.x1; ++x) {
      const Overlap &oy = spans_[std::size_t(y)], &ox = spans_[std::size_t(x)];
      glm::dvec3 sum(0);
      double total = 0;
      for (std::size_t j = 0; j < oy.weights.size(); ++j)
        for (std::size_t i = 0; i < ox.weights.size(); ++i) {
          const int sx = ox.first + int(i), sy = oy.first + int(j);
          const double w = oy.weights[j] * ox.weights[i] *
                           angles_[std::size_t(sy) * std::size_t(fine_) + std::size_t(sx)];
          sum += w * glm::dvec3(fine.texel(r.face, sx, sy));
          total += w;
        }
      coarse.texel(r.face, x, y) = glm::vec3(sum / total);
    }
}

}  // namespace fastibl
