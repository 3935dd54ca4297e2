#include "fastibl/scene/sampled_lobe.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace fastibl {
namespace {

struct HalfVector {
  float x, y, z;      // y across the plane of incidence, z along the normal
  float solid_angle;  // of the taps around it, over all h
};

// Cosine and sine of a half vector, and the part of dh that it stands for.
struct Inclination {
  double cosine, sine, solid_angle;
};
// Where the share u of ∫ (n·h)^s dh = 2π/(s + 1) (1 − cos^{s+1}) is beyond it; of GGX's
// ∫ D (n·h) dh, D = α²/(π ((n·h)² (α² − 1) + 1)²).
Inclination inclination(const LobeShape& lobe, double u, int taps) {
  if (lobe.ggx) {
    const double alpha2 = 2 / double(lobe.exponent), down = 1 - u;  // at the normal: u = 1
    const double cosine2 = u / (1 + (alpha2 - 1) * down), cosine = std::sqrt(cosine2);
    const double d = cosine2 * (alpha2 - 1) + 1;
    const double angle = std::numbers::pi * d * d / (alpha2 * cosine * taps);
    return {cosine, std::sqrt(std::max(0.0, 1 - cosine2)), angle};
  }
  const double power = 1 / (double(lobe.exponent) + 1), c = std::pow(u, power),
               h = std::sqrt(std::max(0.0, -std::expm1(2 * power * std::log(u))));
  // 1/(N p), p = (s + 1)/(2π) c^s, c^−s = c/u.
  return {c, h, 2 * std::numbers::pi * power / taps * c / u};
}

// Half vectors of one lobe, kept for the next call of a thread: a scene has few lobes.
struct Lattice {
  LobeShape lobe{-1};
  int taps = 0;
  std::vector<HalfVector> half;

  void set(const LobeShape& asked, int count) {
    if (asked.exponent == lobe.exponent && asked.ggx == lobe.ggx && count == taps) return;
    lobe = asked, taps = count;
    half.clear();
    // Equal shares; an odd tap takes the one at the normal.
    const int pairs = taps / 2;
    const auto add = [&](double u, double turn) {
      const auto [c, h, angle] = inclination(lobe, u, taps);
      for (const double side : {1.0, -1.0}) {
        half.push_back(
            {float(h * std::cos(turn)), float(side * h * std::sin(turn)), float(c), float(angle)});
        if (turn == 0) break;
      }
    };
    for (int k = 0; k < pairs; ++k) {
      const double golden = k * 0.61803398874989485 + 0.5;
      add((2 * k + 1.0) / taps, std::numbers::pi * (golden - std::floor(golden)));
    }
    if (taps % 2 != 0) add(1 - 0.5 / taps, 0);
  }
};

glm::vec3 nearest_texel(const CubeLevel& level, glm::vec3 direction) {
  const TexelPlace at = texel_at(direction, level.size());
  return level.texel(at.face, at.x, at.y);
}

// Mean over about the solid angle around a unit direction.
glm::vec3 filtered(const CubeMap& map, glm::vec3 l, float solid_angle, float nearest) {
  const glm::vec3 a = glm::abs(l);
  const float major = std::max({a.x, a.y, a.z}), n = float(map.size());
  const float texel = 4 / (n * n) * major * major * major;
  const float level = 0.5f * std::log2(std::max(solid_angle, 1e-30f) / texel);
  if (level >= 0 || nearest <= 0) return map.sample(l, level);
  // From the blend between texels to the texels themselves where four to sixteen taps fall on each:
  // fewer would count them unevenly.
  const float share = nearest * std::clamp(-level - 1, 0.0f, 1.0f);
  const glm::vec3 texels = nearest_texel(map.level(0), l);
  return share >= 1 ? texels : glm::mix(map.sample(l, 0), texels, share);
}

// Unit tangent along the plane of incidence; where the view is along the normal, any that does not
// jump at a cube's edge.
glm::vec3 incidence(glm::vec3 n, glm::vec3 v) {
  const glm::vec3 along = v - glm::dot(v, n) * n;
  constexpr glm::vec3 axis(0.36f, 0.48f, 0.8f);
  const glm::vec3 t = along + 1e-5f * (axis - glm::dot(axis, n) * n);
  const float length = glm::length(t);
  return length > 1e-12f ? t / length : glm::vec3(0.8f, -0.6f, 0);
}

}  // namespace

float sampled_texel_share(float s, int face_size) {
  const float texels = 2 / std::sqrt(s + 1) * float(face_size) / (kPi / 2);  // the lobe's deviation
  return std::clamp(2 * texels - 1, 0.0f, 1.0f);
}

std::span<const LobeTap> lobe_taps(const CubeMap& map, glm::vec3 n, glm::vec3 v,
                                   const LobeShape& lobe, int taps) {
  thread_local std::vector<LobeTap> found;
  found.clear();
  const glm::vec3 mirror = 2 * glm::dot(n, v) * n - v;
  const float s = lobe.exponent, nearest = sampled_texel_share(s, map.size());
  float total = 0;
  if (!std::isinf(s)) {
    thread_local Lattice lattice;
    lattice.set(lobe, taps);
    const glm::vec3 t = incidence(n, v), b = glm::cross(n, t);
    const float alpha2 = 2 / s, nv = std::max(glm::dot(n, v), 1e-3f);
    const float view_mask = std::sqrt(alpha2 + (1 - alpha2) * nv * nv);
    for (const HalfVector& half : lattice.half) {
      const glm::vec3 h = half.x * t + half.y * b + half.z * n;
      const float vh = glm::dot(v, h);
      const glm::vec3 l = 2 * vh * h - v;
      const float nl = glm::dot(n, l);
      if (!(vh > 0 && nl > 0)) continue;
      float weight = vh * nl;  // dl = 4 (v·h) dh
      if (lobe.ggx)            // by Smith's shadowing and masking over 4 (n·l) (n·v), times n·l
        weight /= half.z * (std::sqrt(alpha2 + (1 - alpha2) * nl * nl) * nv + view_mask * nl);
      found.push_back({l, filtered(map, l, 4 * vh * half.solid_angle, nearest), weight});
      total += weight;
    }
  }
  // Below: all taps graze, and their light, times such weights, would vanish in float.
  if (total > 1e-12f) return found;
  found.assign(1, {mirror, map.sample(mirror, 0), 1});
  return found;
}

glm::vec3 sampled_lobe(const CubeMap& map, glm::vec3 n, glm::vec3 v, float s, int taps) {
  glm::vec3 sum(0);
  float total = 0;
  for (const LobeTap& tap : lobe_taps(map, n, v, {s}, taps))
    sum += tap.weight * tap.radiance, total += tap.weight;
  return sum / total;
}

}  // namespace fastibl
