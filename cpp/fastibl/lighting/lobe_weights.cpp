// Compiled with contraction into fused multiply-adds (CMakeLists.txt).
#include "fastibl/lighting/lobe_weights.h"

#include <algorithm>

#include "fastibl/core/lanes.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// Constants of a lobe: for ggx a = α² and b = (1 − α²)/(2α²); otherwise a is the exponent.
struct Shape {
  float a, b;
};

// Height at t, and its second derivative. With f = 1/(1 + b t), ggx is (1 − t) f².
template <LobeModel model, typename V>
FASTIBL_INLINE void evaluate(const Shape& shape, const V& t, V& height, V& second) {
  if constexpr (model == LobeModel::ggx) {
    const V f = 1 / (1 + shape.b * t), bf = shape.b * f;
    height = (1 - t) * f * f;
    second = bf * f * f * ((1 - t) * 6 * bf + 4);
  } else if constexpr (model == LobeModel::phong) {  // c^p, c = 1 − t
    V log;
    log1m(t, log);
    exp_negative(shape.a * log, height);
    const V c = 1 - t;
    second = height * (shape.a * (shape.a - 1)) / (c * c);
  } else {  // h^q (1 − t), h = 1 − t/2, q = s/2
    V log, power;
    log1m(0.5f * t, log);
    const float q = 0.5f * shape.a;
    exp_negative(q * log, power);
    const V h = 1 - 0.5f * t;
    height = power * (1 - t);
    second = power / h * ((1 - t) * (q * (q - 1) / 4) / h + q);
  }
}

// One part of the texels. The mean over a texel of solid angle ω exceeds the height at the mean
// direction by half the second derivative times the variance of t, which is
// sin²θ ω/12 = t (2 − t) ω/12.
template <LobeModel model, typename V>
FASTIBL_INLINE void set_part(const Shape& shape, const SixteenDirections& d, const SeenTexel* texel,
                             std::size_t count, float* weights, float* totals) {
  for (int lane = 0; lane < kLanes; lane += kFloatsIn<V>) {
    const V ox = floats_at<V>(d.x + lane), oy = floats_at<V>(d.y + lane),
            oz = floats_at<V>(d.z + lane);
    V sum{};
    for (std::size_t i = 0; i < count; ++i) {
      const SeenTexel& s = texel[i];
      const V dx = ox - s.x, dy = oy - s.y, dz = oz - s.z;
      const V given = s.deficit + 0.5f * (dx * dx + dy * dy + dz * dz);
      // Below the horizon and beyond its reach the height is 0; there t is set to where all is
      // finite.
      const V t = given < 0.9999f ? given : V{} + 0.9999f;
      V height, second;
      evaluate<model>(shape, t, height, second);
      const V mean = height + second * (t * (2 - t)) * (s.extent / 24);
      const V weight = (mean > 0 ? mean : V{}) * s.angle;
      const V kept = given < 0.9999f ? weight : V{};
      put_floats(kept, weights + i * kLanes + lane);
      sum += kept;
    }
    put_floats(floats_at<V>(totals + lane) + sum, totals + lane);
  }
}

FASTIBL_BY_WIDTH(void set_ggx(const Shape& s, const SixteenDirections& d, const SeenTexel* texel,
                              std::size_t count, float* weights, float* totals),
                 set_part<LobeModel::ggx, V>(s, d, texel, count, weights, totals))
FASTIBL_BY_WIDTH(void set_phong(const Shape& s, const SixteenDirections& d, const SeenTexel* texel,
                                std::size_t count, float* weights, float* totals),
                 set_part<LobeModel::phong, V>(s, d, texel, count, weights, totals))
FASTIBL_BY_WIDTH(void set_blinn(const Shape& s, const SixteenDirections& d, const SeenTexel* texel,
                                std::size_t count, float* weights, float* totals),
                 set_part<LobeModel::blinn, V>(s, d, texel, count, weights, totals))

}  // namespace

void set_lobe_weights(const Lobe& lobe, const SixteenDirections& directions,
                      std::span<const SeenTexel> texels, float* weights, float* totals) {
  const double a = lobe.parameter * lobe.parameter;
  const Shape shape = lobe.model == LobeModel::ggx ? Shape{float(a), float((1 - a) / (2 * a))}
                                                   : Shape{float(lobe.parameter), 0};
  for (std::size_t i = 0; i < texels.size(); i += 64) {
    const std::size_t count = std::min(texels.size() - i, std::size_t(64));
    float* to = weights + i * kLanes;
    switch (lobe.model) {
      case LobeModel::ggx:
        set_ggx(shape, directions, &texels[i], count, to, totals);
        break;
      case LobeModel::phong:
        set_phong(shape, directions, &texels[i], count, to, totals);
        break;
      case LobeModel::blinn:
        set_blinn(shape, directions, &texels[i], count, to, totals);
        break;
    }
  }
}

}  // namespace fastibl
