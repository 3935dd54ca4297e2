#include "fastibl/render/true_light.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "fastibl/core/lanes.h"
#include "fastibl/core/parallel.h"
#include "fastibl/render/sharp_lobe.h"
#include "fastibl/shading/light_sums.h"

namespace fastibl {
namespace {

constexpr int kGrain = 8;
static_assert(SceneSamples::kLevelSize % kLanes == 0);

}  // namespace

SampleFlux::SampleFlux(const CubeMap& map, const SceneSamples& samples) {
  constexpr int n = SceneSamples::kLevelSize;
  const CubeLevel& level = map.level_at_most(n);
  for (std::size_t k = 0; k < samples.direction_count(); ++k) {
    const int face = int(k) / (n * n), y = int(k) / n % n, x = int(k) % n;
    const glm::vec3 light =
        samples.solid_angles[k] *
        (level.size() == n ? level.texel(face, x, y) : level.sample(samples.directions[k]));
    for (int c = 0; c < 3; ++c) channels[c].push_back(light[c]);
    all += light;
    const float z = samples.directions[k].z;
    (z > 0 ? plane : below) += std::abs(z) * light;
  }
}

BrightPieces::BrightPieces(const CubeMap& map, const SceneSamples& samples, const SampleFlux& flux)
    : cut(samples.direction_count(), 0) {
  constexpr float kShare =
      1 / 200.0f;  // of the light on the plane, or of twice what comes from all sides
  constexpr int n = SceneSamples::kLevelSize;
  constexpr int kFine = n * kParts;
  const CubeLevel& fine = map.level_at_most(kFine);
  const int pieces = kFine % fine.size() ? 0 : kFine / fine.size();  // along a texel's edge
  const auto large = [&](glm::vec3 part, glm::vec3 whole) {
    return part.x > kShare * whole.x || part.y > kShare * whole.y || part.z > kShare * whole.z;
  };
  for (std::size_t k = 0; k < samples.direction_count(); ++k) {
    const glm::vec3 light = flux[k];
    if (!large(std::max(samples.directions[k].z, 0.0f) * light, flux.plane) &&
        !large(2.0f * light, flux.all))
      continue;
    cut[k] = 1, cut_texels.push_back(k);
    const int face = int(k) / (n * n), row = int(k) / n % n, column = int(k) % n;
    const std::size_t first = lit.size();
    glm::vec3 sum(0);
    for (int v = 0; v < kParts; ++v)
      for (int u = 0; u < kParts; ++u) {
        const int at_x = column * kParts + u, at_y = row * kParts + v;
        const glm::vec3 d = glm::normalize(texel_direction(face, at_x, at_y, kFine));
        const glm::vec3 radiance =
            pieces ? fine.texel(face, at_x / pieces, at_y / pieces) : fine.sample(d);
        sum += radiance;
        lit.add(d, samples.solid_angles[k] / kCount, radiance);
      }
    for (int c = 0; c < 3; ++c)
      for (std::size_t i = first; i < lit.size(); ++i)
        lit.channels[c][i] *= sum[c] > 0 ? light[c] / sum[c] : 0.0f;
  }
}

bool same_around(const std::uint8_t* cells, std::size_t direction) {
  constexpr int n = SceneSamples::kLevelSize;
  const int row = int(direction) / n % n, column = int(direction) % n;
  if (row == 0 || row == n - 1 || column == 0 || column == n - 1) return false;
  const std::uint8_t* at = cells + direction;
  for (int v = -1; v <= 1; ++v)
    for (int u = -1; u <= 1; ++u)
      if (at[v * n + u] != at[0]) return false;
  return true;
}

namespace {

// Which pieces are free, seen from a sample: the same as their texel where its neighbours in the
// face are like it, otherwise by rays. Pieces below the tangent plane may be called free.
void free_pieces(const SceneSamples& samples, const BrightPieces& bright, std::size_t sample,
                 std::vector<std::uint8_t>& free) {
  constexpr std::size_t kCount = BrightPieces::kCount;
  const std::uint8_t* coarse = &samples.free[sample * samples.direction_count()];
  const SceneSamples::Surface& s = samples.surface[sample];
  std::vector<std::size_t> asked;
  free.assign(bright.lit.size(), 0);
  for (std::size_t b = 0; b < bright.cut_texels.size(); ++b) {
    const std::size_t k = bright.cut_texels[b];
    const bool same = same_around(coarse, k);
    for (std::size_t i = b * kCount; i < (b + 1) * kCount; ++i) {
      if (same)
        free[i] = coarse[k];
      else if (glm::dot(bright.lit.direction(i), s.normal) > 0)
        asked.push_back(i);
    }
  }
  if (asked.empty()) return;
  const std::vector<std::uint8_t> hidden = bright.lit.met(*samples.bvh, s.start, asked);
  for (std::size_t i = 0; i < asked.size(); ++i) free[asked[i]] = !hidden[i];
}

// The same for light that a sample sees elsewhere than the map has it.
void free_near(const SceneSamples& samples, const LitList& seen, std::size_t sample,
               std::vector<std::uint8_t>& free) {
  const std::uint8_t* coarse = &samples.free[sample * samples.direction_count()];
  const SceneSamples::Surface& s = samples.surface[sample];
  std::vector<std::size_t> asked;
  free.assign(seen.size(), 0);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const std::size_t k = SceneSamples::direction_at(seen.direction(i));
    if (same_around(coarse, k))
      free[i] = coarse[k];
    else if (glm::dot(seen.direction(i), s.normal) > 0)
      asked.push_back(i);
  }
  if (asked.empty()) return;
  const std::vector<std::uint8_t> hidden = seen.met(*samples.bvh, s.start, asked);
  for (std::size_t i = 0; i < asked.size(); ++i) free[asked[i]] = !hidden[i];
}

}  // namespace

TrueLight true_light(const CubeMap& map, const SceneSamples& samples, const SampleFlux& flux,
                     const BrightPieces& bright, const NearTruth& near_lights,
                     const std::optional<LobeShape>& lobe) {
  const std::size_t count = samples.surface.size(), directions = samples.direction_count();
  const std::vector<glm::vec3> black(count, glm::vec3(0));
  TrueLight light{black, black, black, black, black, black};
  std::vector<float> x, y, z;
  for (const glm::vec3& d : samples.directions)
    x.push_back(d.x), y.push_back(d.y), z.push_back(d.z);
  std::vector<float> rest[3];
  for (int c = 0; c < 3; ++c) {
    rest[c] = flux.channels[c];
    for (const std::size_t k : bright.cut_texels) rest[c][k] = 0;
  }
  static_assert(BrightPieces::kCount % kLanes == 0);
  const bool sharp = lobe && lobe->exponent > SharpLobe::kSharpest;
  const LobeHeight none(std::nullopt), height = sharp ? none : LobeHeight(lobe);
  const LitDirections coarse{x.data(),
                             y.data(),
                             z.data(),
                             samples.solid_angles.data(),
                             {rest[0].data(), rest[1].data(), rest[2].data()},
                             directions};
  const LitDirections fine = bright.lit.lit(), distant = near_lights.distant().lit();
  parallel_for(int(count), kGrain, [&](int begin, int end) {
    std::vector<std::uint8_t> free;
    LitList seen_near;
    std::optional<SharpLobe> sharp_lobe;
    if (sharp) sharp_lobe.emplace(map, samples, flux, near_lights, *lobe);
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      const SceneSamples::Surface& s = samples.surface[i];
      if (sharp_lobe && i < samples.seen) {
        const SharpLobe::Light reflected = (*sharp_lobe)(i);
        light.lobe[i] = reflected.free, light.open_lobe[i] = reflected.open;
      }
      const LobeHeight& seen = i < samples.seen ? height : none;
      LightSums sums, more, near{}, in_map{};
      sum_light(coarse, &samples.free[i * directions], s.normal, s.to_eye, seen, sums);
      free_pieces(samples, bright, i, free);
      sum_light(fine, free.data(), s.normal, s.to_eye, seen, more);
      if (!near_lights.empty()) {
        sum_light(distant, free.data(), s.normal, s.to_eye, none, in_map);
        near_lights.look(s.position, seen_near);
        free_near(samples, seen_near, i, free);
        sum_light(seen_near.lit(), free.data(), s.normal, s.to_eye, seen, near);
      }
      for (int c = 0; c < 3; ++c) {
        light.open_irradiance[i][c] =
            sums.open_irradiance[c] + more.open_irradiance[c] + in_map.open_irradiance[c];
        light.irradiance[i][c] = sums.irradiance[c] + more.irradiance[c] + near.irradiance[c];
        if (!(sums.height > 0)) continue;
        light.open_lobe[i][c] =
            (sums.open_lobe[c] + more.open_lobe[c] + near.open_lobe[c]) / sums.height;
        light.lobe[i][c] = (sums.lobe[c] + more.lobe[c] + near.lobe[c]) / sums.height;
      }
    }
  });
  return light;
}

void add_lost(const SceneSamples& samples, const SampleFlux& flux, const ShadowMap& shadow,
              TrueLight& light) {
  constexpr std::size_t kStep = 12;  // one of so many directions, other ones for each sample
  const std::size_t directions = samples.direction_count();
  const glm::vec3 even = flux.below / kPi;  // radiance
  parallel_for(int(samples.surface.size()), kGrain, [&](int begin, int end) {
    std::vector<glm::vec2> points;
    std::vector<glm::vec3> weights, ratios;
    std::vector<float> angles;  // projected solid angles
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      const SceneSamples::Surface& s = samples.surface[i];
      points.clear(), weights.clear(), angles.clear();
      for (std::size_t k = i % kStep; k < directions; k += kStep) {
        const glm::vec3 d = samples.directions[k];
        if (!samples.free[i * directions + k] || !(d.z < 0) || !(s.position.z > 0)) continue;
        points.push_back(glm::vec2(s.position) - s.position.z / d.z * glm::vec2(d));
        weights.push_back(float(kStep) * glm::dot(d, s.normal) * flux[k]);
        angles.push_back(float(kStep) * glm::dot(d, s.normal) * samples.solid_angles[k]);
      }
      ratios.assign(points.size(), glm::vec3(1));
      shadow.sample(points, ratios);
      for (std::size_t k = 0; k < points.size(); ++k) {
        light.lost[i] += weights[k] * (1.0f - ratios[k]);
        light.lost_of_even[i] += angles[k] * even * (1.0f - ratios[k]);
      }
    }
  });
}

}  // namespace fastibl
