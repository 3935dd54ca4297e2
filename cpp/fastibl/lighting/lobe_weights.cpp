// Compiled with contraction into fused multiply-adds (CMakeLists.txt).
#include "fastibl/lighting/lobe_weights.h"

#include <algorithm>

#include "fastibl/core/lanes.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// Constants of a lobe: for ggx a = α² and b = (1 − α²)/(2α²); else a the exponent.
struct Shape {
  float a, b;
};

// Height at t, and its second derivative. With f = 1/(1 + b t), ggx is (1 − t) f².
template <LobeModel model>
FASTIBL_INLINE void evaluate(const Shape& shape, const Lanes& t, Lanes& height, Lanes& second) {
  if constexpr (model == LobeModel::ggx) {
    const Lanes f = 1 / (1 + shape.b * t), bf = shape.b * f;
    height = (1 - t) * f * f;
    second = bf * f * f * ((1 - t) * 6 * bf + 4);
  } else if constexpr (model == LobeModel::phong) {  // c^p, c = 1 − t
    Lanes log;
    log1m(t, log);
    exp_negative(shape.a * log, height);
    const Lanes c = 1 - t;
    second = height * (shape.a * (shape.a - 1)) / (c * c);
  } else {  // h^q (1 − t), h = 1 − t/2, q = s/2
    Lanes log, power;
    log1m(0.5f * t, log);
    const float q = 0.5f * shape.a;
    exp_negative(q * log, power);
    const Lanes h = 1 - 0.5f * t;
    height = power * (1 - t);
    second = power / h * ((1 - t) * (q * (q - 1) / 4) / h + q);
  }
}

// One part of texels. The mean over a texel of solid angle ω has half the second derivative times
// the variance of t more than the height at the mean direction, and that variance is sin²θ ω/12 =
// t (2 − t) ω/12.
template <LobeModel model>
FASTIBL_INLINE void set_part(const Shape& shape, const SixteenDirections& d, const SeenTexel* texel,
                             std::size_t count, float* weights, float* totals) {
  const Lanes ox = *reinterpret_cast<const Lanes*>(d.x);
  const Lanes oy = *reinterpret_cast<const Lanes*>(d.y);
  const Lanes oz = *reinterpret_cast<const Lanes*>(d.z);
  Lanes sum{};
  for (std::size_t i = 0; i < count; ++i) {
    const SeenTexel& s = texel[i];
    const Lanes dx = ox - s.x, dy = oy - s.y, dz = oz - s.z;
    const Lanes given = s.deficit + 0.5f * (dx * dx + dy * dy + dz * dz);
    // Below the horizon and beyond its reach the height is 0; there t is set where all is finite.
    const Lanes t = given < 0.9999f ? given : Lanes{} + 0.9999f;
    Lanes height, second;
    evaluate<model>(shape, t, height, second);
    const Lanes mean = height + second * (t * (2 - t)) * (s.extent / 24);
    const Lanes weight = (mean > 0 ? mean : Lanes{}) * s.angle;
    const Lanes kept = given < 0.9999f ? weight : Lanes{};
    reinterpret_cast<Lanes*>(weights)[i] = kept;
    sum += kept;
  }
  *reinterpret_cast<Lanes*>(totals) += sum;
}

FASTIBL_CLONES void set_ggx(const Shape& s, const SixteenDirections& d, const SeenTexel* texel,
                                 std::size_t count, float* weights, float* totals) {
  set_part<LobeModel::ggx>(s, d, texel, count, weights, totals);
}
FASTIBL_CLONES void set_phong(const Shape& s, const SixteenDirections& d,
                                   const SeenTexel* texel, std::size_t count, float* weights,
                                   float* totals) {
  set_part<LobeModel::phong>(s, d, texel, count, weights, totals);
}
FASTIBL_CLONES void set_blinn(const Shape& s, const SixteenDirections& d,
                                   const SeenTexel* texel, std::size_t count, float* weights,
                                   float* totals) {
  set_part<LobeModel::blinn>(s, d, texel, count, weights, totals);
}

}  // namespace

void set_lobe_weights(const Lobe& lobe, const SixteenDirections& directions,
                      std::span<const SeenTexel> texels, float* weights, float* totals) {
  const double a = lobe.parameter * lobe.parameter;
  const Shape shape = lobe.model == LobeModel::ggx ? Shape{float(a), float((1 - a) / (2 * a))}
                                                   : Shape{float(lobe.parameter), 0};
  const auto set = lobe.model == LobeModel::ggx     ? set_ggx
                   : lobe.model == LobeModel::phong ? set_phong
                                                    : set_blinn;
  for (std::size_t i = 0; i < texels.size(); i += 64)
    set(shape, directions, &texels[i], std::min(texels.size() - i, std::size_t(64)),
        weights + i * kLanes, totals);
}

}  // namespace fastibl
