#include "fastibl/scene/sampled_lobe.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

// The shares of the lobe by which half vectors are drawn, kept for a thread's next call: a scene
// has few lobes. They are equal shares, in pairs on both sides of y = 0; an odd tap takes the one
// at the normal.
struct Share {
  double beyond;  // part of the lobe's integral that lies farther from the normal than this tap
  double turn;    // angle from the x axis
  double side;    // 1 or −1: sign of y
};
std::vector<Share> equal_shares(int taps) {
  std::vector<Share> shares;
  for (int k = 0; k < taps / 2; ++k) {
    const double golden = k * 0.61803398874989485 + 0.5;
    const double turn = std::numbers::pi * (golden - std::floor(golden));
    for (const double side : {1.0, -1.0}) shares.push_back({(2 * k + 1.0) / taps, turn, side});
  }
  if (taps % 2 != 0) shares.push_back({1 - 0.5 / taps, 0, 1});
  return shares;
}

struct HalfVector {
  float x, y, z;      // y across the plane of incidence, z along the normal
  float solid_angle;  // of the taps around it, over all h
};
// Drawn by (n·h)^s.
struct PowerLattice {
  float exponent = -1;
  int taps = 0;
  std::vector<HalfVector> half;

  void set(float asked, int count) {
    if (asked == exponent && count == taps) return;
    exponent = asked, taps = count;
    half.clear();
    const double power = 1 / (double(exponent) + 1);
    for (const Share& share : equal_shares(taps)) {
      // Of ∫ (n·h)^s dh = 2π/(s + 1) (1 − cos^{s+1}).
      const double u = share.beyond, c = std::pow(u, power),
                   h = std::sqrt(std::max(0.0, -std::expm1(2 * power * std::log(u))));
      // 1/(N p), p = (s + 1)/(2π) c^s, c^−s = c/u.
      const double angle = 2 * std::numbers::pi * power / taps * c / u;
      half.push_back({float(h * std::cos(share.turn)), float(share.side * h * std::sin(share.turn)),
                      float(c), float(angle)});
    }
  }
};

// Drawn by GGX's D (n·h), in slopes over alpha, whose density is 1/(π (1 + x² + y²)²).
struct SlopeLattice {
  struct Slope {
    float x, y;
    float area;  // of the taps around it
  };
  std::vector<Slope> slopes;

  void set(int taps) {
    if (std::size_t(taps) == slopes.size()) return;
    slopes.clear();
    for (const Share& share : equal_shares(taps)) {
      const double u = share.beyond, steep = std::sqrt((1 - u) / u);
      slopes.push_back({float(steep * std::cos(share.turn)),
                        float(share.side * steep * std::sin(share.turn)),
                        float(std::numbers::pi / (u * u * taps))});
    }
  }
};

// A thread's taps, kept to reuse their memory.
class Taps {
 public:
  Taps() { found().clear(); }
  void add(glm::vec3 direction, glm::vec3 radiance, float weight) {
    found().push_back({direction, radiance, weight});
    total_ += weight;
  }
  std::span<const LobeTap> or_mirror(const SeenMap& map, glm::vec3 mirror) {
    // Below this, all taps graze, and their light times such weights would vanish in float.
    if (!(total_ > 1e-12f)) found().assign(1, {mirror, map.sample(mirror), 1});
    return found();
  }

 private:
  static std::vector<LobeTap>& found() {
    thread_local std::vector<LobeTap> taps;
    return taps;
  }
  float total_ = 0;
};

std::span<const LobeTap> power_taps(const SeenMap& map, const SurfaceFrame& frame, glm::vec3 v,
                                    float s, int taps) {
  const auto& [t, b, n] = frame;
  const glm::vec3 mirror = 2 * glm::dot(n, v) * n - v;
  Taps found;
  if (std::isinf(s)) return found.or_mirror(map, mirror);
  thread_local PowerLattice lattice;
  lattice.set(s, taps);
  const float nearest = shared::sampled_texel_share(s, float(map.size()));
  for (const HalfVector& half : lattice.half) {
    const glm::vec3 h = half.x * t + half.y * b + half.z * n;
    const float vh = glm::dot(v, h);
    const glm::vec3 l = 2 * vh * h - v;
    const float nl = glm::dot(n, l);
    if (!(vh > 0 && nl > 0)) continue;
    // dl = 4 (v·h) dh
    found.add(l, map.mean(l, 4 * vh * half.solid_angle, nearest), vh * nl);
  }
  return found.or_mirror(map, mirror);
}

}  // namespace

std::span<const LobeTap> ggx_lobe_taps(const SeenMap& map, const SurfaceFrame& frame, glm::vec3 v,
                                       glm::vec2 alpha, int taps, float f0) {
  thread_local SlopeLattice lattice;
  lattice.set(taps);
  const auto& [t, b, n] = frame;
  const shared::GgxLobe lobe =
      shared::ggx_lobe({glm::dot(v, t), glm::dot(v, b), glm::dot(v, n)}, alpha);
  const float nearest = shared::sampled_texel_share(2 / (alpha.x * alpha.y), float(map.size()));
  const auto turned = [&](glm::vec3 l) { return l.x * t + l.y * b + l.z * n; };
  Taps found;
  for (const SlopeLattice::Slope& slope : lattice.slopes) {
    const glm::vec4 part = shared::ggx_slope(lobe, slope.x, slope.y);
    if (!(part.w > 0)) continue;
    const glm::vec3 l = glm::vec3(part) / part.w;
    const glm::vec3 direction = turned(l);
    found.add(direction, map.mean(direction, shared::ggx_solid_angle(lobe, l, slope.area), nearest),
              part.w * (f0 + (1 - f0) * shared::ggx_edge(l, lobe.view)));
  }
  return found.or_mirror(map, turned({-lobe.view.x, -lobe.view.y, lobe.view.z}));
}

std::span<const LobeTap> lobe_taps(const SeenMap& map, glm::vec3 n, glm::vec3 v,
                                   const LobeShape& lobe, int taps) {
  const glm::vec3 t = shared::incidence_tangent(n, v);
  const SurfaceFrame frame{t, glm::cross(n, t), n};
  if (!lobe.ggx) return power_taps(map, frame, v, lobe.exponent, taps);
  return ggx_lobe_taps(map, frame, v, glm::vec2(std::sqrt(2 / lobe.exponent)), taps, lobe.f0);
}

glm::vec3 mean_radiance(std::span<const LobeTap> taps) {
  glm::vec3 sum(0);
  float total = 0;
  for (const LobeTap& tap : taps) sum += tap.weight * tap.radiance, total += tap.weight;
  return sum / total;
}

}  // namespace fastibl
