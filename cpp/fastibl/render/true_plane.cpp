#include "fastibl/render/true_plane.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/response.h"

namespace fastibl {
namespace {

// What of the sky the object hides from a place on the plane.
class HiddenFrom {
 public:
  // hidden: of the samples' directions, 1 where one is hidden there.
  HiddenFrom(const SceneSamples& samples, glm::vec2 place, const std::uint8_t* hidden)
      : samples_(samples),
        hidden_(hidden),
        from_(place, samples.above),
        to_(samples.centre - from_) {
    const float distance = glm::length(to_), sine = samples.radius / distance;
    least_ = sine < 1 ? std::sqrt(1 - sine * sine) * distance : -distance;
  }

  // The pieces' light that does not reach the plane.
  glm::vec3 of(const BrightPieces& bright) const {
    constexpr std::size_t kCount = BrightPieces::kCount;
    glm::vec3 lost(0);
    std::vector<std::size_t> asked;
    for (std::size_t b = 0; b < bright.cut_texels.size(); ++b) {
      const Known known = around(bright.cut_texels[b]);
      if (known == Known::free) continue;
      for (std::size_t i = b * kCount; i < (b + 1) * kCount; ++i)
        sort(bright.lit, i, known, lost, asked);
    }
    return lost + met(bright.lit, asked);
  }
  // The same for light that the place sees elsewhere than the map has it.
  glm::vec3 of(const LitList& seen) const {
    glm::vec3 lost(0);
    std::vector<std::size_t> asked;
    for (std::size_t i = 0; i < seen.size(); ++i)
      sort(seen, i, around(SceneSamples::direction_at(seen.direction(i))), lost, asked);
    return lost + met(seen, asked);
  }
  glm::vec3 place() const { return from_; }

 private:
  // What all of a texel and of those around it have in common.
  enum class Known { free, hidden, no };
  Known around(std::size_t k) const {
    if (!same_around(hidden_, k)) return Known::no;
    return hidden_[k] ? Known::hidden : Known::free;
  }
  // Adds a direction's light where it is known to be hidden, or asks for a ray.
  void sort(const LitList& lit, std::size_t i, Known known, glm::vec3& lost,
            std::vector<std::size_t>& asked) const {
    if (!(lit.z[i] > 0)) return;
    if (known == Known::hidden) lost += lit.z[i] * lit.flux(i);
    if (known == Known::no && glm::dot(lit.direction(i), to_) >= least_) asked.push_back(i);
  }
  glm::vec3 met(const LitList& lit, const std::vector<std::size_t>& asked) const {
    glm::vec3 lost(0);
    if (asked.empty()) return lost;
    const std::vector<std::uint8_t> met = lit.met(*samples_.bvh, from_, asked);
    for (std::size_t i = 0; i < asked.size(); ++i)
      if (met[i]) lost += lit.z[asked[i]] * lit.flux(asked[i]);
    return lost;
  }

  const SceneSamples& samples_;
  const std::uint8_t* hidden_;
  glm::vec3 from_, to_;
  float least_;  // of what meets the object, along to_
};

// What directions send to the plane.
glm::vec3 sent_down(const LitList& lit) {
  glm::vec3 sum(0);
  for (std::size_t i = 0; i < lit.size(); ++i) sum += std::max(lit.z[i], 0.0f) * lit.flux(i);
  return sum;
}

// Mean of the light `sent` by the samples, as it reaches a place on the plane; each sample is
// weighted by the form factor of the surface that it stands for. Where any of them sees the place,
// those do not count from which other parts of the object hide it: a cup's inside is dark.
glm::vec3 mean_received(const SceneSamples& samples, const std::vector<glm::vec3>& sent,
                        glm::vec2 place) {
  constexpr float kGrazing = 0.1f;
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
    if (samples.free[i * samples.direction_count() + SceneSamples::direction_at(-d)])
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
                       const BrightPieces& bright, const NearTruth& near_lights,
                       const std::vector<glm::vec3>& sent) {
  const std::size_t places = samples.plane.size();
  PlaneTruth truth{std::vector<glm::vec3>(places, glm::vec3(1)),
                   std::vector<glm::vec3>(places, glm::vec3(0)),
                   {}};
  std::vector<std::uint8_t> counts(places, 0);
  const glm::vec3 distant = flux.plane - sent_down(near_lights.distant());
  parallel_for(int(places), 16, [&](int begin, int end) {
    std::vector<std::uint8_t> hidden(samples.direction_count());
    LitList seen_near;
    for (std::size_t p = std::size_t(begin); p < std::size_t(end); ++p) {
      const auto directions =
          std::span(samples.hidden)
              .subspan(samples.plane_first[p], samples.plane_first[p + 1] - samples.plane_first[p]);
      std::fill(hidden.begin(), hidden.end(), std::uint8_t(0));
      for (const std::uint16_t k : directions) hidden[k] = 1;
      const HiddenFrom from(samples, samples.plane[p], hidden.data());
      near_lights.look(from.place(), seen_near);
      glm::vec3 lost = from.of(bright) + from.of(seen_near);
      const glm::vec3 whole = distant + sent_down(seen_near);
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
        if (whole[c] > 0) {
          ratio[c] = std::max(1 - lost[c] / whole[c], 0.0f);
          added[c] = light[c] / whole[c];
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
