#include "fastibl/render/true_light.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "fastibl/core/lanes.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr int kGrain = 8;
static_assert(SceneSamples::kLevelSize % kLanes == 0);

// Height of a material's lobe towards a direction.
struct LobeHeight {
  bool any = false, ggx = false;
  float exponent = 0, alpha2 = 0, f0 = 1;
  float least = 0;  // n·h: below it there is 1e-4 of the peak

  explicit LobeHeight(const std::optional<LobeShape>& shape) {
    if (!shape) return;
    constexpr float kSharpest = 600;  // sharper ones fall between the directions
    any = true, ggx = shape->ggx, f0 = shape->f0;
    exponent = std::min(shape->exponent, kSharpest);
    if (ggx)
      alpha2 = 2 / exponent;
    else
      least = std::exp2(std::log2(1e-4f) / std::max(exponent, 1e-3f));
  }
};

struct Sums {
  float irradiance[3], open_irradiance[3], lobe[3], open_lobe[3], height;
};

using Bytes [[gnu::vector_size(kLanes)]] = std::uint8_t;

FASTIBL_INLINE void load(const float* from, Lanes& to) { std::memcpy(&to, from, sizeof to); }

FASTIBL_INLINE void square_root(const Lanes& x, Lanes& result) {
  for (int k = 0; k < kLanes; ++k) result[k] = std::sqrt(x[k]);
}

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
  Lanes away = 1 - half, logarithm;  // half < 1 by rounding alone is 1
  away = away > 0 ? away : none;
  away = away < 0.999999f ? away : none + 0.999999f;
  log1m(away, logarithm);
  exp_negative(lobe.exponent * logarithm, height);
  height = half >= lobe.least ? height * cosine : none;
}

// Sums over all directions above the tangent plane. free: of those, which the object does not hide.
FASTIBL_CLONES
void sum_directions(const float* x, const float* y, const float* z, const float* solid_angle,
                    const float* red, const float* green, const float* blue, std::size_t count,
                    const std::uint8_t* free, const glm::vec3& normal, const glm::vec3& view,
                    const LobeHeight& lobe, Sums& out) {
  const Lanes none{};
  const float nv = normal.x * view.x + normal.y * view.y + normal.z * view.z;
  const float view_cosine = nv > 1e-3f ? nv : 1e-3f;
  Lanes open[3]{}, seen[3]{}, open_lobe[3]{}, lobe_seen[3]{}, height{};
  for (std::size_t k = 0; k < count; k += kLanes) {
    Lanes dx, dy, dz;
    load(x + k, dx), load(y + k, dy), load(z + k, dz);
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
    load(red + k, light[0]), load(green + k, light[1]), load(blue + k, light[2]);
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
    load(solid_angle + k, angle);
    height += weight * angle;
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
  out.height = total(height);
}

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
    plane += std::max(samples.directions[k].z, 0.0f) * light;
  }
}

BrightPieces::BrightPieces(const CubeMap& map, const SceneSamples& samples, const SampleFlux& flux)
    : cut(samples.direction_count(), 0) {
  constexpr float kShare =
      1 / 200.0f;  // of the light on the plane, or of twice what comes from all sides
  constexpr int n = SceneSamples::kLevelSize;
  const CubeLevel& fine = map.level_at_most(n * kParts);
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
    const std::size_t first = count();
    glm::vec3 sum(0);
    for (int v = 0; v < kParts; ++v)
      for (int u = 0; u < kParts; ++u) {
        const glm::vec3 d = glm::normalize(
            texel_direction(face, column * kParts + u, row * kParts + v, n * kParts));
        const glm::vec3 radiance = fine.sample(d);
        sum += radiance;
        x.push_back(d.x), y.push_back(d.y), z.push_back(d.z);
        solid_angles.push_back(samples.solid_angles[k] / kCount);
        for (int c = 0; c < 3; ++c) channels[c].push_back(radiance[c]);
      }
    for (int c = 0; c < 3; ++c)
      for (std::size_t i = first; i < count(); ++i)
        channels[c][i] *= sum[c] > 0 ? light[c] / sum[c] : 0.0f;
  }
}

namespace {

// Which pieces are free from a sample: as the texel where its neighbours in the face are the same,
// else by rays. Pieces below the tangent plane may be called free.
void free_pieces(const SceneSamples& samples, const BrightPieces& bright, std::size_t sample,
                 std::vector<std::uint8_t>& free) {
  constexpr int n = SceneSamples::kLevelSize;
  constexpr std::size_t kCount = BrightPieces::kCount;
  const std::uint8_t* coarse = &samples.free[sample * samples.direction_count()];
  const SceneSamples::Surface& s = samples.surface[sample];
  std::vector<std::size_t> asked;
  free.assign(bright.count(), 0);
  for (std::size_t b = 0; b < bright.cut_texels.size(); ++b) {
    const std::size_t k = bright.cut_texels[b];
    const int row = int(k) / n % n, column = int(k) % n;
    bool same = row > 0 && row < n - 1 && column > 0 && column < n - 1;
    for (int v = -1; same && v <= 1; ++v)
      for (int u = -1; u <= 1; ++u)
        same = same && coarse[std::ptrdiff_t(k) + v * n + u] == coarse[k];
    for (std::size_t i = b * kCount; i < (b + 1) * kCount; ++i) {
      if (same)
        free[i] = coarse[k];
      else if (glm::dot(bright.direction(i), s.normal) > 0)
        asked.push_back(i);
    }
  }
  if (asked.empty()) return;
  DirectionSet set(int(asked.size()));
  for (std::size_t i = 0; i < asked.size(); ++i) set.set(int(i), bright.direction(asked[i]));
  std::vector<std::uint8_t> hidden(asked.size());
  samples.bvh->occluded(s.start, set, 0, hidden);
  for (std::size_t i = 0; i < asked.size(); ++i) free[asked[i]] = !hidden[i];
}

}  // namespace

TrueLight true_light(const SceneSamples& samples, const SampleFlux& flux,
                     const BrightPieces& bright, const std::optional<LobeShape>& lobe) {
  const std::size_t count = samples.surface.size(), directions = samples.direction_count();
  const std::vector<glm::vec3> black(count, glm::vec3(0));
  TrueLight light{black, black, black, black, black};
  std::vector<float> x, y, z;
  for (const glm::vec3& d : samples.directions)
    x.push_back(d.x), y.push_back(d.y), z.push_back(d.z);
  std::vector<float> rest[3];
  for (int c = 0; c < 3; ++c) {
    rest[c] = flux.channels[c];
    for (const std::size_t k : bright.cut_texels) rest[c][k] = 0;
  }
  static_assert(BrightPieces::kCount % kLanes == 0);
  const LobeHeight height(lobe), none(std::nullopt);
  parallel_for(int(count), kGrain, [&](int begin, int end) {
    std::vector<std::uint8_t> free;
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      const SceneSamples::Surface& s = samples.surface[i];
      const LobeHeight& seen = i < samples.seen ? height : none;
      Sums sums, more;
      sum_directions(x.data(), y.data(), z.data(), samples.solid_angles.data(), rest[0].data(),
                     rest[1].data(), rest[2].data(), directions, &samples.free[i * directions],
                     s.normal, samples.views[std::size_t(s.view)], seen, sums);
      free_pieces(samples, bright, i, free);
      sum_directions(bright.x.data(), bright.y.data(), bright.z.data(), bright.solid_angles.data(),
                     bright.channels[0].data(), bright.channels[1].data(),
                     bright.channels[2].data(), bright.count(), free.data(), s.normal,
                     samples.views[std::size_t(s.view)], seen, more);
      for (int c = 0; c < 3; ++c) {
        light.open_irradiance[i][c] = sums.open_irradiance[c] + more.open_irradiance[c];
        light.irradiance[i][c] = sums.irradiance[c] + more.irradiance[c];
        if (!(sums.height > 0)) continue;
        light.open_lobe[i][c] = (sums.open_lobe[c] + more.open_lobe[c]) / sums.height;
        light.lobe[i][c] = (sums.lobe[c] + more.lobe[c]) / sums.height;
      }
    }
  });
  return light;
}

void add_lost(const SceneSamples& samples, const SampleFlux& flux, const ShadowMap& shadow,
              TrueLight& light) {
  constexpr std::size_t kStep = 12;  // of the directions, other ones for each sample
  const std::size_t directions = samples.direction_count();
  parallel_for(int(samples.surface.size()), kGrain, [&](int begin, int end) {
    std::vector<glm::vec2> points;
    std::vector<glm::vec3> weights, ratios;
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      const SceneSamples::Surface& s = samples.surface[i];
      points.clear(), weights.clear();
      for (std::size_t k = i % kStep; k < directions; k += kStep) {
        const glm::vec3 d = samples.directions[k];
        if (!samples.free[i * directions + k] || !(d.z < 0) || !(s.position.z > 0)) continue;
        points.push_back(glm::vec2(s.position) - s.position.z / d.z * glm::vec2(d));
        weights.push_back(float(kStep) * glm::dot(d, s.normal) * flux[k]);
      }
      ratios.assign(points.size(), glm::vec3(1));
      shadow.sample(points, ratios);
      for (std::size_t k = 0; k < points.size(); ++k)
        light.lost[i] += weights[k] * (1.0f - ratios[k]);
    }
  });
}

}  // namespace fastibl
