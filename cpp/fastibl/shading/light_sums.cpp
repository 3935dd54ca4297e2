#include "fastibl/shading/light_sums.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "fastibl/core/lanes.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

using Bytes [[gnu::vector_size(kLanes)]] = std::uint8_t;

FASTIBL_INLINE void load(const float* from, Lanes& to) { std::memcpy(&to, from, sizeof to); }

FASTIBL_INLINE void lobe_heights(const LobeHeight& lobe, const Lanes& cosine, const Lanes& half,
                                 float view, Lanes& height) {
  const Lanes none{};
  if (lobe.ggx) {
    const float alpha2 = lobe.alpha2, rest = 1 - alpha2;
    const float view_mask = std::sqrt(alpha2 + rest * view * view);
    const Lanes d = half * half * (alpha2 - 1) + 1;
    Lanes mask;
    square_root(alpha2 + rest * cosine * cosine, mask);
    mask = mask * view + view_mask * cosine;
    height = cosine / (d * d * (mask > 1e-9f ? mask : none + 1e-9f));
    return;
  }
  Lanes away = 1 - half, logarithm;  // half < 1 by rounding alone counts as 1
  away = away > 0 ? away : none;
  away = away < 0.999999f ? away : none + 0.999999f;
  log1m(away, logarithm);
  exp_negative(lobe.exponent * logarithm, height);
  height = half >= lobe.least ? height * cosine : none;
}

FASTIBL_CLONES
void weigh_by_width(const LitDirections& of, float width, const glm::vec3& normal,
                    const glm::vec3& view, const LobeHeight& lobe, float* weights) {
  const Lanes none{};
  const float nv = normal.x * view.x + normal.y * view.y + normal.z * view.z;
  const float view_cosine = nv > 1e-3f ? nv : 1e-3f, exponent = std::max(lobe.exponent, 1e-3f);
  for (std::size_t k = 0; k < of.count; k += kLanes) {
    Lanes dx, dy, dz, light, weight;
    load(of.x + k, dx), load(of.y + k, dy), load(of.z + k, dz), load(of.channels[0] + k, light);
    const Lanes middle = dx * normal.x + dy * normal.y + dz * normal.z;
    // A square whose middle is below the horizon may have a part above it.
    Lanes cosine = middle + 0.5f * width, sum = middle + nv;
    cosine = cosine > 0 ? cosine : none;
    sum = sum > 0 ? sum : none;
    Lanes length2 = 2 + 2 * (dx * view.x + dy * view.y + dz * view.z);
    length2 = length2 > 1e-4f ? length2 : none + 1e-4f;
    Lanes half2 = sum * sum / length2;
    half2 = half2 < 1 ? half2 : none + 1;
    // The half vector turns by half of what the direction does, and across their plane by that over
    // v·h, which is half the length.
    const Lanes variance = width * width / length2;
    if (lobe.ggx) {
      Lanes alpha2 = lobe.alpha2 + 2 * variance, root;
      alpha2 = alpha2 < 1 ? alpha2 : none + 1;
      const Lanes d = half2 * (alpha2 - 1) + 1;
      square_root(alpha2 + (1 - alpha2) * cosine * cosine, root);
      Lanes view_root;
      square_root(alpha2 + (1 - alpha2) * view_cosine * view_cosine, view_root);
      weight = cosine / (d * d * (root * view_cosine + view_root * cosine + 1e-9f));
    } else {
      Lanes away = 1 - half2, logarithm;
      away = away < 0.999999f ? away : none + 0.999999f;
      log1m(away, logarithm);
      exp_negative(0.5f * logarithm / (1 / exponent + variance), weight);
      weight *= cosine;
    }
    weight *= light;
    std::memcpy(weights + k, &weight, sizeof weight);
  }
}

FASTIBL_CLONES
void sum_by_width(const LitDirections& of, const std::uint8_t* free, const glm::vec3& normal,
                  const glm::vec3& view, const LobeHeight& lobe, LightSums& out) {
  const Lanes none{};
  const float nv = normal.x * view.x + normal.y * view.y + normal.z * view.z;
  const float view_cosine = nv > 1e-3f ? nv : 1e-3f;
  Lanes open[3]{}, seen[3]{}, open_lobe[3]{}, lobe_seen[3]{}, height{}, squares{};
  for (std::size_t k = 0; k < of.count; k += kLanes) {
    Lanes dx, dy, dz;
    load(of.x + k, dx), load(of.y + k, dy), load(of.z + k, dz);
    Lanes cosine = dx * normal.x + dy * normal.y + dz * normal.z;
    const IntLanes above = cosine > 0;
    std::int32_t any = 0;
    for (int i = 0; i < kLanes; ++i) any |= above[i];
    if (any == 0) continue;
    cosine = above ? cosine : none;
    Bytes bytes;
    std::memcpy(&bytes, free + k, sizeof bytes);
    const IntLanes is_free = __builtin_convertvector(bytes, IntLanes) != 0;
    Lanes light[3];
    for (int c = 0; c < 3; ++c) load(of.channels[c] + k, light[c]);
    for (int c = 0; c < 3; ++c) {
      const Lanes part = cosine * light[c];
      open[c] += part;
      seen[c] += is_free ? part : none;
    }
    if (!lobe.any) continue;
    Lanes length2 = 2 + 2 * (dx * view.x + dy * view.y + dz * view.z), length;
    length2 = length2 > 1e-9f ? length2 : none + 1e-9f;
    square_root(length2, length);
    const Lanes half = (cosine + nv) / length;
    if (!lobe.ggx) {
      const IntLanes near = half >= lobe.least;
      any = 0;
      for (int i = 0; i < kLanes; ++i) any |= near[i] & above[i];
      if (any == 0) continue;
    }
    Lanes weight, angle;
    lobe_heights(lobe, cosine, half, view_cosine, weight);
    if (lobe.ggx) {  // by Schlick's Fresnel term
      const Lanes away = 1 - 0.5f * length, away2 = away * away;
      weight = weight * (lobe.f0 + (1 - lobe.f0) * (away2 * away2 * away));
    }
    load(of.solid_angles + k, angle);
    height += weight * angle;
    const Lanes whole = weight * (light[0] + light[1] + light[2]);
    squares += whole * whole;
    for (int c = 0; c < 3; ++c) {
      const Lanes part = weight * light[c];
      open_lobe[c] += part;
      lobe_seen[c] += is_free ? part : none;
    }
  }
  for (int c = 0; c < 3; ++c) {
    out.open_irradiance[c] = total(open[c]), out.irradiance[c] = total(seen[c]);
    out.open_lobe[c] = total(open_lobe[c]), out.lobe[c] = total(lobe_seen[c]);
  }
  out.height = total(height), out.open_squares = total(squares);
}

}  // namespace

LobeHeight::LobeHeight(const std::optional<LobeShape>& shape, float sharpest) {
  if (!shape) return;
  any = true, ggx = shape->ggx, f0 = shape->f0;
  exponent = std::min(shape->exponent, sharpest);
  if (ggx)
    alpha2 = 2 / exponent;
  else
    least = std::exp2(std::log2(1e-4f) / std::max(exponent, 1e-3f));
}

void weigh_squares(const LitDirections& of, float width, const glm::vec3& normal,
                   const glm::vec3& view, const LobeHeight& lobe, float* weights) {
  weigh_by_width(of, width, normal, view, lobe, weights);
}

void sum_light(const LitDirections& of, const std::uint8_t* free, const glm::vec3& normal,
               const glm::vec3& view, const LobeHeight& lobe, LightSums& out) {
  sum_by_width(of, free, normal, view, lobe, out);
}

}  // namespace fastibl
