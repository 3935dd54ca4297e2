#include "fastibl/render/true_plane.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/response.h"

namespace fastibl {
namespace {

// The pieces' light that the object hides from a place. hidden: 1 for directions hidden there.
glm::vec3 hidden_light(const BrightPieces& bright, const SceneSamples& samples, glm::vec2 place,
                       const std::uint8_t* hidden) {
  const glm::vec3 from(place, samples.above), to = samples.centre - from;
  const float distance = glm::length(to);
  const float cosine = distance > samples.radius
                           ? std::sqrt(1 - samples.radius * samples.radius / (distance * distance))
                           : -1;
  glm::vec3 lost(0);
  std::vector<std::size_t> asked;
  constexpr std::size_t kCount = BrightPieces::kCount;
  for (std::size_t b = 0; b < bright.cut_texels.size(); ++b) {
    const std::size_t k = bright.cut_texels[b];
    const bool same = same_around(hidden, k);
    if (same && !hidden[k]) continue;
    for (std::size_t i = b * kCount; i < (b + 1) * kCount; ++i) {
      if (!(bright.z[i] > 0)) continue;
      if (same)
        lost += bright.z[i] * bright.flux(i);
      else if (glm::dot(bright.direction(i), to) >= cosine * distance)
        asked.push_back(i);
    }
  }
  if (asked.empty()) return lost;
  DirectionSet set(int(asked.size()));
  for (std::size_t i = 0; i < asked.size(); ++i) set.set(int(i), bright.direction(asked[i]));
  std::vector<std::uint8_t> met(asked.size(), 0);
  samples.bvh->occluded(from, set, 0, met);
  for (std::size_t i = 0; i < asked.size(); ++i)
    if (met[i]) lost += bright.z[asked[i]] * bright.flux(asked[i]);
  return lost;
}

// Mean of the light `sent` by the samples, as it reaches a place on the plane; each sample is
// weighted by the form factor of the surface that it stands for. Where any of them sees the place,
// those do not count from which other parts of the object hide it: a cup's inside is dark.
glm::vec3 mean_received(const SceneSamples& samples, const std::vector<glm::vec3>& sent,
                        glm::vec2 place) {
  constexpr float kGrazing = 0.1f;
  constexpr std::size_t n = SceneSamples::kLevelSize;
  constexpr std::size_t kEnough = 1200;  // samples: as many as all views have
  const float near2 = 1e-4f * samples.radius * samples.radius;
  glm::vec3 sum(0), free_sum(0);
  float all = 0, all_free = 0;
  const std::size_t step = (sent.size() + kEnough - 1) / kEnough;
  for (std::size_t i = 0; i < sent.size(); i += step) {
    const SceneSamples::Surface& s = samples.surface[i];
    const glm::vec3 d = s.position - glm::vec3(place, 0);
    const float facing = -glm::dot(s.normal, d), distance2 = glm::dot(d, d) + near2;
    if (!(facing > 0 && d.z > 0)) continue;
    const float seen = std::max(glm::dot(s.normal, s.to_eye), kGrazing);
    const float part = facing * d.z / (seen * distance2 * distance2);
    sum += part * sent[i], all += part;
    const TexelPlace towards = texel_at(-d, int(n));
    const std::size_t k =
        (std::size_t(towards.face) * n + std::size_t(towards.y)) * n + std::size_t(towards.x);
    if (samples.free[i * samples.direction_count() + k])
      free_sum += part * sent[i], all_free += part;
  }
  return all_free > 0 ? free_sum / all_free : all > 0 ? sum / all : glm::vec3(0);
}

}  // namespace

bool shows_on_plane(glm::vec3 gain) {
  static const Response response;
  static const float bare = response.encode(kPlaneLevel);
  bool any = false;
  for (int c = 0; c < 3; ++c)
    any |= std::abs(response.encode(kPlaneLevel * gain[c]) - bare) > 1 / 255.0f;
  return any;
}

PlaneTruth plane_truth(const SceneSamples& samples, const SampleFlux& flux,
                       const BrightPieces& bright, const std::vector<glm::vec3>& sent) {
  const std::size_t places = samples.plane.size();
  PlaneTruth truth{std::vector<glm::vec3>(places, glm::vec3(1)),
                   std::vector<glm::vec3>(places, glm::vec3(0)),
                   {}};
  std::vector<std::uint8_t> counts(places, 0);
  parallel_for(int(places), 16, [&](int begin, int end) {
    std::vector<std::uint8_t> hidden(samples.direction_count());
    for (std::size_t p = std::size_t(begin); p < std::size_t(end); ++p) {
      const auto directions =
          std::span(samples.hidden)
              .subspan(samples.plane_first[p], samples.plane_first[p + 1] - samples.plane_first[p]);
      std::fill(hidden.begin(), hidden.end(), std::uint8_t(0));
      for (const std::uint16_t k : directions) hidden[k] = 1;
      glm::vec3 lost = hidden_light(bright, samples, samples.plane[p], hidden.data());
      float factor = 0;
      for (const std::uint16_t k : directions) {
        const float z = samples.directions[k].z;
        if (!bright.cut[k]) lost += z * flux[k];
        factor += z * samples.solid_angles[k] / kPi;
      }
      const glm::vec3 light =
          factor > 0 ? factor * mean_received(samples, sent, samples.plane[p]) : glm::vec3(0);
      glm::vec3 &ratio = truth.ratio[p], &added = truth.added[p];
      for (int c = 0; c < 3; ++c) {
        if (flux.plane[c] > 0) {
          ratio[c] = std::max(1 - lost[c] / flux.plane[c], 0.0f);
          added[c] = light[c] / flux.plane[c];
        }
      }
      counts[p] = shows_on_plane(ratio + added);
    }
  });
  for (std::size_t p = 0; p < places; ++p)
    if (counts[p]) truth.counted.push_back(p);
  return truth;
}

}  // namespace fastibl
