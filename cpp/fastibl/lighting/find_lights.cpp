#include "fastibl/lighting/find_lights.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

constexpr double kThreshold = 4;  // times the mean of the map: what is brighter belongs to lights
constexpr float kInner = 5 * kPi / 180, kOuter = 7.5f * kPi / 180;  // a disc fades out between
// A light that holds a smaller share of the map's light than this stays in the map. Up to twice the
// share a part of it does, so that a light neither appears nor vanishes at once.
constexpr double kLeastShare = 0.0025;
// How much the share that a light holds of its disc may change from one map to the next, apart from
// what the map changed there: lights are shaded more sharply than the map, and would pop.
constexpr float kFade = 0.04f;
// A light that appears lets another one of up to this share of it go at once.
constexpr double kMasks = 0.5;
constexpr int kCandidates = 64;

struct Bright {
  int face, x, y;
  glm::vec3 direction;
  glm::vec3 excess;  // radiance above the threshold
  float solid_angle;
  float flux;         // mean over RGB of the excess
  float before = -1;  // the same in the map before
  float left = 1;     // the share that no light has taken yet
};

double mean(glm::vec3 v) { return (double(v.x) + v.y + v.z) / 3; }

float smooth(float t) {
  t = std::clamp(t, 0.0f, 1.0f);
  return t * t * (3 - 2 * t);
}

float window(glm::vec3 a, glm::vec3 b) {
  static const float inner = std::cos(kInner), outer = std::cos(kOuter);
  return smooth((glm::dot(a, b) - outer) / (inner - outer));
}

struct BrightTexels {
  std::vector<Bright> texels;
  double total = 0;  // flux of the whole map
};

// before: the previous map's level, or null.
BrightTexels bright_texels(const CubeLevel& level, const CubeLevel* before) {
  const int n = level.size();
  static const std::vector<double> of_working_size = texel_solid_angles(64);
  const std::vector<double> angles = n == 64 ? of_working_size : texel_solid_angles(n);
  BrightTexels bright;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x)
        bright.total +=
            angles[std::size_t(y) * std::size_t(n) + std::size_t(x)] * mean(level.texel(f, x, y));
  const double threshold = kThreshold * bright.total / (4 * std::numbers::pi);
  if (!(threshold > 0)) return bright;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const glm::vec3& radiance = level.texel(f, x, y);
        const double value = mean(radiance);
        if (!(value > threshold)) continue;
        const glm::vec3 excess = float(1 - threshold / value) * radiance;
        const float angle = float(angles[std::size_t(y) * std::size_t(n) + std::size_t(x)]);
        Bright texel{f,
                     x,
                     y,
                     glm::normalize(texel_direction(f, x, y, n)),
                     excess,
                     angle,
                     angle * float(mean(excess))};
        texel.before = texel.flux;
        if (before)
          texel.before = angle * float(std::max(mean(before->texel(f, x, y)) - threshold, 0.0));
        bright.texels.push_back(texel);
      }
  return bright;
}

// The middle of the light around a direction, by mean shift with the window.
glm::vec3 settled(const std::vector<Bright>& texels, glm::vec3 direction) {
  for (int round = 0; round < 30; ++round) {
    glm::dvec3 sum(0);
    for (const Bright& t : texels)
      sum += glm::dvec3(t.direction) * double(t.flux * t.left * window(t.direction, direction));
    const double length = glm::length(sum);
    if (!(length > 0)) break;
    const glm::vec3 next = glm::vec3(sum / length);
    const bool same = glm::length(next - direction) < 1e-5f;
    direction = next;
    if (same) break;
  }
  return direction;
}

// Where a light of an earlier frame is now. Its window stays while the middle of the light is
// within half a degree of the window's, and follows it beyond. Settling anew would let the window
// drift along lights that are larger than it.
glm::vec3 followed(const std::vector<Bright>& texels, glm::vec3 window_middle) {
  constexpr double kSlack = 0.5 * kDegree;
  glm::dvec3 sum(0);
  for (const Bright& t : texels)
    sum += glm::dvec3(t.direction) * double(t.flux * t.left * window(t.direction, window_middle));
  if (!(glm::length(sum) > 0)) return window_middle;
  const glm::dvec3 step = glm::normalize(sum) - glm::dvec3(window_middle);
  const double length = glm::length(step);
  if (length <= kSlack) return window_middle;
  return glm::vec3(glm::normalize(glm::dvec3(window_middle) + (1 - kSlack / length) * step));
}

double flux_around(const std::vector<Bright>& texels, glm::vec3 direction) {
  double sum = 0;
  for (const Bright& t : texels) sum += t.flux * t.left * window(t.direction, direction);
  return sum;
}

// The direction whose window holds most of the light that is left.
glm::vec3 brightest(const std::vector<Bright>& texels) {
  std::vector<const Bright*> order;
  for (const Bright& t : texels) order.push_back(&t);
  const std::size_t count = std::min<std::size_t>(kCandidates, order.size());
  std::partial_sort(order.begin(), order.begin() + std::ptrdiff_t(count), order.end(),
                    [](const Bright* a, const Bright* b) {
                      const float fa = a->flux * a->left, fb = b->flux * b->left;
                      return fa != fb ? fa > fb : a < b;
                    });
  double most = -1;
  glm::vec3 best(0, 0, 1);
  for (std::size_t i = 0; i < count; ++i) {
    const double flux = flux_around(texels, order[i]->direction);
    if (flux > most) most = flux, best = order[i]->direction;
  }
  return settled(texels, best);
}

struct TakenLight {
  glm::vec3 centre;
  double flux = 0;                                  // mean over RGB
  double flux_before = 0;                           // in the map before, at the same place
  float before = 0;                                 // its strength there
  bool leaves = false;                              // for a stronger one
  float fade = kFade;                               // how much of it may pass to the map, or back
  std::vector<std::pair<std::size_t, float>> part;  // of each texel's excess

  double appeared() const { return std::max(flux - flux_before, 0.0); }
  // The strength nearest to the given one that can be reached from the map before. Flux that came
  // or went may do so in the light or in the map.
  float towards(float strength) const {
    const double held = before * flux_before, went = std::max(flux_before - flux, 0.0);
    return std::clamp(strength, std::max(0.0f, float((held - went) / flux) - fade),
                      float((held + appeared()) / flux) + fade);
  }
};

TakenLight take(std::vector<Bright>& texels, glm::vec3 centre) {
  TakenLight taken;
  taken.centre = centre;
  for (std::size_t i = 0; i < texels.size(); ++i) {
    const float w = texels[i].left * window(texels[i].direction, centre);
    if (!(w > 0)) continue;
    taken.part.emplace_back(i, w);
    taken.flux += double(w) * texels[i].flux;
    taken.flux_before += double(w) * texels[i].before;
    texels[i].left -= w;
  }
  return taken;
}

void give_back(std::vector<Bright>& texels, const TakenLight& taken) {
  for (const auto& [i, w] : taken.part) texels[i].left += w;
}

// The middle of the light in a texel, from a finer level if there is one.
glm::dvec3 middle(const CubeMap& map, int fine, int size, const Bright& t) {
  if (fine < 0) return t.direction;
  const CubeLevel& level = map.level(fine);
  const int n = level.size();
  glm::dvec3 sum(0);
  double total = 0;
  // Of n texels those that lie in one of `size`, and how much of each, in units of 1 / (n · size).
  const auto within = [&](int fine_at, int at) {
    return std::min((fine_at + 1) * size, (at + 1) * n) - std::max(fine_at * size, at * n);
  };
  for (int y = t.y * n / size; y * size < (t.y + 1) * n; ++y)
    for (int x = t.x * n / size; x * size < (t.x + 1) * n; ++x) {
      const double part = double(within(x, t.x)) * within(y, t.y);
      const double value = part * mean(level.texel(t.face, x, y));
      sum += value * glm::normalize(glm::dvec3(texel_direction(t.face, x, y, level.size())));
      total += value;
    }
  return total > 0 ? sum / total : glm::dvec3(t.direction);
}

FoundLight finished(const CubeMap& map, const CubeLevel& level, const std::vector<Bright>& texels,
                    const TakenLight& taken, float strength) {
  int fine = -1;
  for (int k = map.level_count() - 1; k >= 0; --k) {
    const int n = map.level(k).size();
    if (n > level.size() && n <= kFinestForLights) fine = k;
  }
  FoundLight found;
  glm::dvec3 sum(0), flux(0);
  double total = 0;
  std::vector<glm::dvec3> middles;
  for (const auto& [i, w] : taken.part) {
    const Bright& t = texels[i];
    middles.push_back(middle(map, fine, level.size(), t));
    sum += double(w) * t.flux * middles.back();
    total += double(w) * t.flux;
    const glm::vec3 radiance = strength * w * t.excess;
    found.parts.push_back({t.face, t.x, t.y, radiance});
    flux += glm::dvec3(radiance) * double(t.solid_angle);
  }
  const glm::dvec3 direction = glm::normalize(sum);
  glm::dvec3 irradiance(0);
  double spread = 0;
  for (std::size_t k = 0; k < middles.size(); ++k) {
    const Bright& t = texels[taken.part[k].first];
    irradiance += glm::dvec3(found.parts[k].radiance) * double(t.solid_angle) *
                  glm::dot(glm::dvec3(t.direction), direction);
    spread += double(taken.part[k].second) * t.flux *
              (1 - std::min(glm::dot(middles[k], direction), 1.0));
  }
  // 2 (1 − cos δ) ≈ δ², which is the variance along both axes.
  found.light.angular_radius = std::min(float(2 * std::sqrt(spread / total)), kOuter);
  found.light.direction = glm::vec3(direction);
  found.light.window = taken.centre;
  found.light.strength = strength;
  found.light.irradiance = glm::vec3(irradiance);
  found.light.flux = glm::vec3(flux);
  return found;
}

}  // namespace

std::vector<FoundLight> find_lights(const CubeMap& map, const CubeLevel& level, int count,
                                    const LightsBefore* before) {
  check(count >= 0 && count <= kMaxLights, "lights must be from 0 to ", kMaxLights, ", got ",
        count);
  std::vector<FoundLight> found;
  const std::span<const Light> followed_lights = before ? before->lights : std::span<const Light>();
  if (count == 0 && followed_lights.empty()) return found;
  BrightTexels bright = bright_texels(level, before ? &before->level : nullptr);
  std::vector<Bright>& texels = bright.texels;
  if (texels.empty()) return found;
  const double least = kLeastShare * bright.total;
  std::vector<TakenLight> taken;
  for (const Light& light : followed_lights) {
    TakenLight again = take(texels, followed(texels, light.window));
    again.before = light.strength;
    again.leaves = int(taken.size()) >= count;
    if (again.flux > least || (again.flux > 0 && light.strength > kFade))
      taken.push_back(std::move(again));
    else
      give_back(texels, again);
  }
  double next = 0;  // flux of the largest light that there is no room for
  // Full until the surplus lights have faded, and where none is asked for.
  const bool full = count == 0 || int(taken.size()) > count;
  for (int round = 0; !full && round < 2 * kMaxLights; ++round) {
    TakenLight more = take(texels, brightest(texels));
    if (!(more.flux > least)) break;
    if (int(taken.size()) == count) {
      const auto last = std::min_element(
          taken.begin(), taken.end(),
          [](const TakenLight& a, const TakenLight& b) { return a.flux < b.flux; });
      next = more.flux;
      // Only a light that is followed can be this much weaker.
      if (next < 1.5 * last->flux) break;
      last->fade = std::max(kFade, float(kMasks * more.appeared() / last->flux));
      if (last->towards(0) > 0) {
        last->leaves = true;
        break;
      }
      give_back(texels, *last);
      taken.erase(last);
    }
    taken.push_back(std::move(more));
  }
  for (const TakenLight& t : taken) {
    float strength = t.leaves ? 0 : smooth(float(t.flux / least - 1));
    // Without a map before, the last lights fade by how near their flux is to the first that is
    // left out.
    if (!before && next > 0) strength *= smooth(float((t.flux / next - 1) / 0.25));
    if (before) strength = t.towards(strength);
    if (strength > 0) found.push_back(finished(map, level, texels, t, strength));
  }
  return found;
}

}  // namespace fastibl
