#include "fastibl/lighting/small_lights.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// In finer levels, a sun of half a degree would have many texels, and kSmallShare is left in each.
constexpr int kFinest = 512;

double largest(const glm::dvec3& v) { return std::max(std::max(v.x, v.y), v.z); }

constexpr int kAtOnce = 24;  // floats: eight texels

// Whether any of a row's floats is above its channel's limit. limits: kAtOnce.
FASTIBL_CLONES
bool any_above(const float* row, int count, const float* limits) {
  int above[kAtOnce] = {};
  const int whole = count - count % kAtOnce;
  for (int i = 0; i < whole; i += kAtOnce)
    for (int k = 0; k < kAtOnce; ++k) above[k] |= row[i + k] > limits[k];
  for (int i = whole; i < count; ++i) above[0] |= row[i] > limits[i - whole];
  int any = 0;
  for (int k = 0; k < kAtOnce; ++k) any |= above[k];
  return any != 0;
}

// A texel's direction, not normalised, and its solid angle: that of a small square, 0.1 % off at
// 16².
struct Place {
  glm::dvec3 direction;
  double distance, angle;

  Place(const TexelPlace& t, int size)
      : direction(texel_direction(t.face, t.x, t.y, size)),
        distance(glm::length(direction)),
        angle(4 / (double(size) * size * distance * distance * distance)) {}
  glm::dvec3 unit() const { return direction / distance; }
};

class Finder {
 public:
  Finder(const CubeMap& radiance, const CubeLevel& level, int vector_size)
      : radiance_(radiance), vector_size_(vector_size) {
    while (&radiance.level(coarse_) != &level) ++coarse_;
    while (radiance.level(finest_).size() > std::max(kFinest, level.size())) ++finest_;
    const glm::dvec3 all = 4 * std::numbers::pi * radiance.level(radiance.level_count() - 1).mean();
    for (int c = 0; c < 3; ++c) inverse_[c] = all[c] > 0 ? 1 / all[c] : 0;
    for (int k = 0; k <= coarse_; ++k) {
      // No texel is larger than those in the middle of a face.
      const double n = radiance.level(k).size();
      limits_.emplace_back(kSmallShare * n * n / 4 / inverse_);
    }
  }

  SmallLights find() {
    const int n = radiance_.level(coarse_).size();
    if (radiance_.level(finest_).size() != n << (coarse_ - finest_)) return {};
    float limits[kAtOnce];
    for (int k = 0; k < kAtOnce; ++k) limits[k] = limits_.back()[k % 3];
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < n; ++y) {
        const glm::vec3& row = radiance_.level(coarse_).texel(f, 0, y);
        for (int x = any_above(&row.x, 3 * n, limits) ? 0 : n; x < n; ++x)
          if (may_hold({f, x, y}, coarse_)) look_at({f, x, y});
      }
    return std::move(found_);
  }

 private:
  // Quick, and never false where a texel has more than kSmallShare.
  bool may_hold(const TexelPlace& t, int k) const {
    const glm::vec3 radiance = radiance_.level(k).texel(t.face, t.x, t.y),
                    limit = limits_[std::size_t(k)];
    return radiance.x > limit.x || radiance.y > limit.y || radiance.z > limit.z;
  }

  void look_at(const TexelPlace& texel) {
    light_ = {texel, glm::dvec3(0), glm::dvec3(0)};
    look_into(texel, coarse_);
    if (!(largest(light_.flux) > 0)) return;
    light_.direction = glm::normalize(light_.direction);
    found_.lights.push_back(light_);
  }

  void look_into(const TexelPlace& texel, int k) {
    if (k == finest_) return add(texel);
    for (int child = 0; child < 4; ++child) {
      const TexelPlace finer{texel.face, 2 * texel.x + child % 2, 2 * texel.y + child / 2};
      if (may_hold(finer, k - 1)) look_into(finer, k - 1);
    }
  }

  void add(const TexelPlace& texel) {
    const CubeLevel& level = radiance_.level(finest_);
    const int n = level.size();
    const Place place(texel, n);
    const glm::dvec3 all = place.angle * glm::dvec3(level.texel(texel.face, texel.x, texel.y));
    const double share = largest(inverse_ * all);
    if (!(share > kSmallShare)) return;
    const glm::dvec3 flux = (1 - kSmallShare / share) * all;
    const Place in_vector({texel.face, texel.x * vector_size_ / n, texel.y * vector_size_ / n},
                          vector_size_);
    const glm::dvec3 shift = place.unit() - in_vector.unit();
    for (int axis = 0; axis < 3; ++axis) found_.shift[std::size_t(axis)] += shift[axis] * flux;
    light_.flux += flux;
    light_.direction += glm::dot(inverse_, flux) * place.unit();
  }

  const CubeMap& radiance_;
  const int vector_size_;
  int coarse_ = 0, finest_ = 0;    // levels
  glm::dvec3 inverse_{0};          // of all light; 0 for a black channel
  std::vector<glm::vec3> limits_;  // radiance that can count, by level
  SmallLight light_{};             // so far
  SmallLights found_;
};

}  // namespace

SmallLights small_lights(const CubeMap& radiance, const CubeLevel& level, int vector_size) {
  return Finder(radiance, level, vector_size).find();
}

}  // namespace fastibl
