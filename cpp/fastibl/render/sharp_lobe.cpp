#include "fastibl/render/sharp_lobe.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace fastibl {
namespace {

constexpr int kSamplesSize = SceneSamples::kLevelSize;
constexpr float kFaceAngle = float(std::numbers::pi) / 2;

// Standard deviation of a lobe around the mirror direction, radians.
float width_of(const LobeShape& lobe) { return 2 / std::sqrt(lobe.exponent); }

// Pieces along the edge of a texel of the samples' level, no larger than the lobe is wide across
// the plane of reflection, where it is narrower by the cosine of the view.
int parts_for(float width, float view_cosine) {
  constexpr float kLeastCosine = 0.05f;
  constexpr int kMostParts = 64;
  const float wanted = width * std::max(view_cosine, kLeastCosine);
  int parts = 1;
  while (parts < kMostParts && kFaceAngle / float(kSamplesSize * parts) > wanted) parts *= 2;
  return parts;
}

}  // namespace

SharpLobe::SharpLobe(const CubeMap& map, const SceneSamples& samples, const SampleFlux& flux,
                     const NearTruth& near_lights, const LobeShape& lobe)
    : map_(map),
      samples_(samples),
      flux_(flux),
      near_(near_lights),
      height_(lobe),
      width_(width_of(lobe)),
      mirror_(width_ < 0.5f * kFaceAngle / float(map.size())) {
  if (mirror_) return;
  // The lobe has fallen to 1e-4 here.
  constexpr float kWidths = 4.3f;
  reach_ = std::min(kWidths * width_, 1.5f);
}

void SharpLobe::add_parts(std::size_t direction, glm::vec3 from, glm::vec3 mirror, int parts,
                          bool is_free) {
  const int n = kSamplesSize * parts, k = int(direction);
  const int face = k / (kSamplesSize * kSamplesSize), row = k / kSamplesSize % kSamplesSize,
            column = k % kSamplesSize;
  const CubeLevel& level = map_.level_at_most(n);
  const auto texel_of = [&](int i) {
    return int((std::int64_t{2 * i + 1} * level.size()) / (2 * n));
  };
  const float least_cosine = std::cos(reach_), area = 4 / (float(n) * float(n));
  for (int y = row * parts; y < (row + 1) * parts; ++y)
    for (int x = column * parts; x < (column + 1) * parts; ++x) {
      const glm::vec3 at = texel_direction(face, x, y, n);
      const float length = glm::length(at);
      if (glm::dot(at, mirror) > least_cosine * length) {
        const float angle = area / (length * length * length);
        const glm::vec3 d = at / length, radiance = level.texel(face, texel_of(x), texel_of(y));
        lit_.add(d, angle,
                 angle * (by_pieces_ ? near_.without(d, radiance)
                                     : near_.radiance(map_.level(0), from, d, radiance)));
        free_.push_back(is_free);
      }
    }
}

SharpLobe::Light SharpLobe::operator()(std::size_t sample) {
  const SceneSamples::Surface& s = samples_.surface[sample];
  const std::uint8_t* free = &samples_.free[sample * samples_.direction_count()];
  const glm::vec3 mirror = glm::normalize(2 * glm::dot(s.normal, s.to_eye) * s.normal - s.to_eye);
  // Of a texel whose centre is below the tangent plane nothing is known; what is above it is free.
  const auto is_free = [&](std::size_t k) {
    return free[k] || glm::dot(samples_.directions[k], s.normal) <= 0;
  };
  Light light;
  if (mirror_) {
    light.open = near_.radiance(map_.level(0), s.position, mirror, map_.sample(mirror, 0));
    if (is_free(SceneSamples::direction_at(mirror))) light.free = light.open;
    return light;
  }
  lit_.clear(), free_.clear();
  // Whether the lobe is wider than the pieces of near lights seem there.
  constexpr float kPiece = kFaceAngle / float(kSamplesSize * BrightPieces::kParts);
  by_pieces_ = width_ * near_.nearness(s.position) > kPiece;
  constexpr float kDiagonal = 0.045f;  // half of a texel's
  const float near_cosine = std::cos(reach_ + kDiagonal);
  const int parts = parts_for(width_, glm::dot(s.normal, s.to_eye));
  for (std::size_t k = 0; k < samples_.direction_count(); ++k) {
    const glm::vec3 d = samples_.directions[k];
    if (glm::dot(d, mirror) > near_cosine)
      add_parts(k, s.position, mirror, parts, is_free(k));
    else if (height_.ggx && glm::dot(d, s.normal) > 0) {
      lit_.add(d, samples_.solid_angles[k],
               flux_[k] - (by_pieces_ ? near_.taken(k) : glm::vec3(0)));
      free_.push_back(free[k]);
    }
  }
  if (by_pieces_ && !near_.empty()) {
    near_.look(s.position, near_seen_);
    for (std::size_t i = 0; i < near_seen_.size(); ++i) {
      const glm::vec3 d = near_seen_.direction(i);
      lit_.add(d, 0, near_seen_.flux(i));
      free_.push_back(is_free(SceneSamples::direction_at(d)));
    }
  }
  lit_.pad(), free_.resize(lit_.size());
  LightSums sums;
  sum_light(lit_.lit(), free_.data(), s.normal, s.to_eye, height_, sums);
  if (!(sums.height > 0)) return light;
  for (int c = 0; c < 3; ++c) {
    light.open[c] = sums.open_lobe[c] / sums.height;
    light.free[c] = sums.lobe[c] / sums.height;
  }
  return light;
}

}  // namespace fastibl
