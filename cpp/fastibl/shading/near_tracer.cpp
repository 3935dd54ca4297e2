#include "fastibl/shading/near_tracer.h"

#include <algorithm>
#include <cmath>

#include "fastibl/scene/shared_formulas.h"
#include "fastibl/shading/light_disc.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

NearTracer::NearTracer(const Scene& scene, const NearShares& shares)
    : bvh_(*scene.bvh), normals_(scene.normals) {
  const glm::mat3 back = glm::transpose(glm::mat3(scene.marker_from_object.rotation));
  centre_ = back * (shares.centre() - glm::vec3(scene.marker_from_object.translation));
  for (const NearShares::OfLight& of : shares.lights()) {
    const NearLight& l = of.light;
    if (!of.states.empty() && l.inverse_distance > 0)
      lights_.push_back({back * l.direction, l.inverse_distance, l.sin_radius, l.irradiance, &of});
  }
  if (lights_.size() <= std::size_t(kMost)) return;
  const auto brightness = [](const Light& l) {
    return l.irradiance.x + l.irradiance.y + l.irradiance.z;
  };
  std::vector<float> all;
  for (const Light& l : lights_) all.push_back(brightness(l));
  std::ranges::nth_element(all, all.begin() + kMost, std::ranges::greater{});
  std::erase_if(lights_, [&](const Light& l) { return brightness(l) <= all[kMost]; });
}

NearState NearTracer::between(const Light& light, const Entries& entries) const {
  NearState result = NearState::low;
  for (const std::size_t e : entries) {
    const NearState state = light.of->states[e];
    if (result == NearState::low) result = state;
    if (state != result && state != NearState::low) return NearState::mixed;
  }
  return result;
}

bool NearTracer::bent(const Entries& entries) const {
  const auto normal = [&](std::size_t k) { return normals_[entries[k] % normals_.size()]; };
  const glm::vec3 a = normal(0), b = normal(1), c = normal(2);
  return std::min({glm::dot(a, b), glm::dot(b, c), glm::dot(c, a)}) < kBent;
}

// From the middle of what the pixel shows.
glm::vec3 NearTracer::arrow(const Light& light, const Place& place) const {
  glm::vec3 sum(0);
  for (const glm::vec3& p : place.starts) sum += p;
  return shared::near_arrow(light.direction, light.inverse_distance,
                            sum / float(place.starts.size()) - centre_);
}

float NearTracer::open(const Light& light, const Place& place, int& rays) const {
  const NearState state = between(light, place.entries);
  if (state != NearState::mixed) return state == NearState::hidden ? 0 : 1;
  return open_part(light, place, arrow(light, place), rays);
}

glm::vec3 NearTracer::change(const Place& place, std::uint32_t asked, std::span<const float> open,
                             std::span<const float> lost) const {
  const auto share = [](const Light& light, float change, glm::vec3 irradiance) {
    return glm::clamp(share_of(change * light.irradiance, irradiance), -1.0f,
                      NearShares::kMostShare);
  };
  const auto is_asked = [&](std::size_t i) { return (asked >> i & 1) != 0; };
  glm::vec3 sum(0);
  for (std::size_t i = 0; i < lights_.size(); ++i) {
    if (!is_asked(i)) continue;
    const Light& light = lights_[i];
    const float here =
        open[i] * shared::near_irradiance(arrow(light, place), light.sin_radius, place.normal);
    const float there =
        (1 - lost[i]) * shared::near_irradiance(light.direction, light.sin_radius, place.normal);
    sum += share(light, here - there, place.irradiance[3]);
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t entry = place.entries[k];
    glm::vec3 interpolated(0), all = place.own[k];
    for (std::size_t i = 0; i < lights_.size(); ++i) {
      const glm::vec3 change =
          share(lights_[i], lights_[i].of->changes[entry], place.irradiance[k]);
      all += change;
      if (is_asked(i)) interpolated += change;
    }
    interpolated -= glm::min(all, glm::vec3(0));  // no share is negative
    sum -= place.weights[int(k)] * interpolated;
  }
  return sum;
}

namespace {

// The order of a disc's seeds: first those around its rim, of which each third one is 52 degrees
// on.
int seed_of(int k) {
  constexpr int kFirst = NearTracer::kFirst, kPairs = 2 * kFirst;
  static_assert(NearTracer::kRays == 32 && kFirst == 8);
  const int rest = k - kFirst;
  return rest < 0 ? 31 - 3 * k : rest < kPairs ? 30 - 3 * (rest / 2) - rest % 2 : 23 - rest;
}

// From which of a pixel's samples ray k goes: the first ones from two that lie across from each
// other.
std::size_t start_of(int k) {
  return k < NearTracer::kFirst ? 3 * (std::size_t(k) % 2)
                                : std::size_t(k + 1) % NearTracer::kStarts;
}

}  // namespace

float NearTracer::open_part(const Light& light, const Place& place, glm::vec3 arrow,
                            int& rays) const {
  const float length = glm::length(arrow);
  if (length <= light.sin_radius) return 1;  // inside it
  const DiscPoints<kRays> points(arrow / length, light.sin_radius / length);
  thread_local std::array<DirectionSet, kStarts> sets{DirectionSet(0), DirectionSet(0),
                                                      DirectionSet(0), DirectionSet(0)};
  thread_local std::vector<glm::vec3> directions[kStarts];
  thread_local std::vector<std::uint8_t> met;
  const bool several = place.starts.size() == kStarts;
  int asked = 0, free = 0;
  for (int first = 0; first < kRays; first = first == 0 ? kFirst : kRays) {
    for (auto& of_start : directions) of_start.clear();
    for (int k = first; k < (first == 0 ? kFirst : kRays); ++k) {
      const int seed = seed_of(k);
      const glm::vec3 d(points.x[seed], points.y[seed], points.z[seed]);
      if (!(glm::dot(d, place.normal) > 0)) continue;
      directions[several ? start_of(k) : 0].push_back(d);
    }
    for (std::size_t s = 0; s < kStarts; ++s) {
      if (directions[s].empty()) continue;
      const int count = int(directions[s].size());
      sets[s].resize(count);
      for (int i = 0; i < count; ++i) sets[s].set(i, directions[s][std::size_t(i)]);
      met.assign(std::size_t(count), 0);
      bvh_.occluded(place.starts[s], sets[s], 0, met);
      asked += count, free += int(std::ranges::count(met, std::uint8_t{0}));
    }
    if (free == 0 || free == asked) break;
  }
  rays += asked;
  return asked > 0 ? float(free) / float(asked) : 1;
}

float NearTracer::in_lobe(const Light& light, float flux, const Place& place, glm::vec3 view,
                          const LobeHeight& lobe) const {
  return disc_in_lobe(arrow(light, place), light.sin_radius, flux, place.normal, view, lobe);
}

}  // namespace fastibl
