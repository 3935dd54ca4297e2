#include "fastibl/scene/glossy.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/directional_albedo.h"
#include "fastibl/scene/sampled_lobe.h"
#include "fastibl/scene/seen_lights.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

#include "fastibl/scene/glossy_table.inc"

constexpr int kRows = 17;          // exponents 2, 4 … 2^17
constexpr int kHarmonicsRows = 4;  // 1, 2, 4, 8
// Spherical harmonics alone serve up to the first exponent, look-ups alone from the second on.
constexpr float kHarmonicsOnly = 4, kTapsOnly = 8;
// Above it, and for the mirror, a lobe is narrower than any texel, and lights are in the map.
constexpr float kLargest = 1e8f;

// A row blended from two of a table of `rows` × 17 × `width` numbers.
struct Row {
  const float *a, *b;
  float f;
  Row(const float* table, int rows, int width, float at) {
    const float clamped = std::clamp(at, 0.0f, float(rows - 1));
    const int i = std::min(int(clamped), rows - 2);
    a = table + std::ptrdiff_t(i) * GlossyLobe::kColumns * width;
    b = a + GlossyLobe::kColumns * width;
    f = clamped - float(i);
  }
  float operator()(int i) const { return a[i] + f * (b[i] - a[i]); }
};

const float* tap_table(int taps) {
  constexpr const float* tables[] = {kTaps1, kTaps2, kTaps3, kTaps4};
  return tables[taps - 1];
}

// Look-ups, as sum_lights() reads them.
struct Taps {
  int count;
  glm::vec3 direction[GlossyLobe::kMaxTaps];
  float weight[GlossyLobe::kMaxTaps], level[GlossyLobe::kMaxTaps], spread[GlossyLobe::kMaxTaps];
  float harmonics;  // share of spherical harmonics, which hold nothing of the lights
};

// Sum of the lobe over all lights, times the share of each that the look-ups near it do not hold.
// offset: see see_lights().
FASTIBL_CLONES
void sum_lights(const LightArrays& lights, const float* offset, float s, const Taps& taps,
                const float* n, const float* v, float* rgb) {
  float share[kMaxLights], value[kMaxLights];
  SeenLights seen;
  see_lights(lights, offset, seen);
  LightsLeft sums;
  for (int k = 0; k < taps.count; ++k)
    add_look_up(lights, seen.x, seen.y, seen.z, seen.variance, taps.direction[k], taps.spread[k],
                taps.level[k], taps.weight[k], sums);
  for (int i = 0; i < kMaxLights; ++i)
    share[i] =
        taps.harmonics + (1 - taps.harmonics) * sums.left[i] / std::max(sums.around[i], 1e-30f);
  for (int i = 0; i < kMaxLights; ++i)
    value[i] =
        share[i] * seen.gain[i] *
        shared::light_lobe(s, seen.variance[i], glm::vec3(n[0], n[1], n[2]),
                           glm::vec3(v[0], v[1], v[2]), glm::vec3(seen.x[i], seen.y[i], seen.z[i]));
  sum_flux(lights, value, rgb);
}

}  // namespace

GlossyLobe::GlossyLobe(const GlossyChain& chain, int tap_count, float s)
    : exponent(std::min(s, kLargest)), taps(tap_count) {
  const float log_s = std::log2(exponent);
  harmonics = s <= kHarmonicsOnly ? 1 : s < kTapsOnly ? 3 - log_s : 0.0f;
  const float width = 2 / std::sqrt(s);  // 0 for the mirror
  // Lobes that the map's texels cannot show are mirrors: look-ups move to the mirror direction.
  const float shown = std::clamp(2 * width / chain.own_width() - 1, 0.0f, 1.0f);
  const Row tap_row(tap_table(taps), kRows, 3 * taps, log_s - 1);
  const Row harmonics_row(kHarmonics, kHarmonicsRows, 5, log_s);
  const Row integral_row(kLogIntegrals, kRows + 1, 1, log_s);
  for (int c = 0; c < kColumns; ++c) {
    Column& column = columns[std::size_t(c)];
    float last = 1;  // weights sum to 1 more exactly than the table's
    for (int k = 0; k < taps && harmonics < 1; ++k) {
      const int i = (c * taps + k) * 3;
      const float angle = shown * tap_row(i) * width;
      const float weight = k + 1 < taps ? tap_row(i + 2) : last;
      last -= weight;
      const float blur = width * std::exp2(tap_row(i + 1));
      column.taps[std::size_t(k)] = {std::cos(angle), std::sin(angle), chain.level_of(blur),
                                     weight};
      column.spreads[k] = blur * blur;
    }
    if (harmonics > 0) {
      const float angle = harmonics_row(5 * c);
      column.direction = {std::cos(angle), std::sin(angle)};
      for (int l = 0; l < 4; ++l) column.bands[l] = harmonics_row(5 * c + 1 + l);
    }
    column.log_integral = integral_row(c) - log_s;
  }
}

GlossyShading::GlossyShading(const Lighting& lighting, float exponent)
    : lighting_(&lighting), method_(lighting.glossy), exponent_(exponent) {
  check(exponent >= 0, "a lobe's exponent must be at least 0, got ", exponent);
  if (exponent == 0 || !lighting.radiance) return;
  if (!lighting.chain && method_ != GlossyMethod::sampled) method_ = GlossyMethod::mip;
  if (method_ == GlossyMethod::mip) {
    level_ = shared::mip_level(float(lighting.radiance->size()), exponent);
  } else if (lighting.chain) {
    lobe_ = GlossyLobe(*lighting.chain, std::max(lighting.glossy_settings.taps, 1),
                       std::max(exponent, 1.0f));
    lights_ = arrays_of(lighting);
  }
  if (lighting.box) walls_.emplace(*lighting.box, lighting.near_lights.centre);
  placed_ = walls_ || lights_.any_near || lighting.near_radiance;
}

// Where the map shows what is seen in that direction.
glm::vec3 GlossyShading::looked(glm::vec3 direction, const glm::vec3* position) const {
  if (!position || !walls_) return direction;
  return walls_->direction(direction, *position - lighting_->near_lights.centre);
}

glm::vec3 GlossyShading::from_chain(glm::vec3 n, glm::vec3 v, float cosine,
                                    const glm::vec3* position) const {
  const float c = std::clamp(cosine, 0.0f, 1.0f), sine = std::sqrt(1 - c * c);
  glm::vec3 tangent = v - cosine * n;  // towards the view
  tangent *= 1 / std::max(glm::length(tangent), 1e-6f);
  const glm::vec3 mirror = c * n - sine * tangent, down = -sine * n - c * tangent;
  const float column = shared::lobe_column(c);
  const int i = column > 0 ? std::min(int(column), GlossyLobe::kColumns - 2) : 0;  // NaN gives 0
  const float f = column - float(i);
  const GlossyLobe::Column &a = lobe_.columns[std::size_t(i)],
                           &b = lobe_.columns[std::size_t(i) + 1];
  glm::vec3 value(0);
  Taps taps;
  taps.count = 0;
  taps.harmonics = lobe_.harmonics;
  float highest = 0;  // level; below the finest light's, look-ups hold all light
  const glm::vec3 offset = position ? *position - lighting_->near_lights.centre : glm::vec3(0);
  const float* beside = position && lights_.any_near ? &offset.x : nullptr;
  SeenLights seen;
  if (beside) see_lights(lights_, beside, seen);
  if (lobe_.harmonics > 0) {
    const glm::vec2 angle = a.direction + f * (b.direction - a.direction);
    value = lobe_.harmonics *
            shared::harmonics_radiance(lighting_->chain->harmonics.data(),
                                       glm::normalize(angle.x * mirror + angle.y * down),
                                       a.bands + f * (b.bands - a.bands));
  }
  if (lobe_.harmonics < 1) {
    taps.count = lobe_.taps;
    const glm::vec4 spreads = a.spreads + f * (b.spreads - a.spreads);
    for (int k = 0; k < lobe_.taps; ++k) {
      const glm::vec4 &p = a.taps[std::size_t(k)], &q = b.taps[std::size_t(k)];
      const glm::vec4 tap = p + f * (q - p);
      const glm::vec3 direction = tap.x * mirror + tap.y * down;
      ChainLookUp at{looked(direction, position), tap.z};
      if (beside)
        at = moved(lights_, seen, direction, glm::normalize(at.direction), tap.z, spreads[k]);
      value += (1 - lobe_.harmonics) * tap.w * lighting_->chain->sample(at.direction, at.level);
      highest = std::max(highest, at.level);
      taps.direction[k] = direction, taps.weight[k] = tap.w, taps.level[k] = at.level;
      taps.spread[k] = spreads[k];
    }
  }
  if (lights_.count > 0 && (lobe_.harmonics > 0 || highest > lights_.finest - 1)) {
    float rgb[3];
    sum_lights(lights_, beside, lobe_.exponent, taps, &n.x, &v.x, rgb);
    const float integral = a.log_integral + f * (b.log_integral - a.log_integral);
    value += std::exp2(-integral) * glm::vec3(rgb[0], rgb[1], rgb[2]);
  }
  return value;
}

glm::vec3 GlossyShading::reflected(glm::vec3 n, glm::vec3 v, float cosine,
                                   const glm::vec3* position) const {
  // Eq. 3 with s = 0 is Lambert's law; up to s = 1 it is blended with the lobe of s = 1.
  if (exponent_ == 0) return evaluate(lighting_->irradiance, n) / kPi;
  if (method_ == GlossyMethod::mip)
    return lighting_->radiance->sample(looked(2 * cosine * n - v, position), level_);
  if (method_ == GlossyMethod::sampled)
    return mean_radiance(lobe_taps({*lighting_, walls_, position}, n, v, {exponent_},
                                   lighting_->glossy_settings.taps));
  const glm::vec3 value = from_chain(n, v, cosine, position);
  if (exponent_ >= 1) return value;
  const glm::vec3 matte = evaluate(lighting_->irradiance, n) / kPi;
  return matte + exponent_ * (value - matte);
}

float GlossyShading::scale(float cosine) const {
  if (lighting_->normalization == Normalization::energy || exponent_ == 0) return 1;
  return albedo_scale(lighting_->normalization, exponent_) * directional_albedo(cosine, exponent_);
}

glm::vec3 GlossyShading::shaded(glm::vec3 n, glm::vec3 v, const glm::vec3* position) const {
  check(exponent_ == 0 || lighting_->radiance, "the lighting has no map");
  const float cosine = glm::dot(n, v);
  return scale(cosine) * reflected(n, v, cosine, position);
}

glm::vec3 evaluate_glossy(const Lighting& lighting, glm::vec3 normal, glm::vec3 view,
                          float exponent) {
  return GlossyShading(lighting, exponent)(normal, view);
}

}  // namespace fastibl
