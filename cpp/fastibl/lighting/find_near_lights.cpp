#include "fastibl/lighting/find_near_lights.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr int kWorkSize = 64;     // texels along a face of the level that is searched
constexpr double kOutline = 1.5;  // times the angular radius, and
constexpr double kTexels = 1.5;   // texels more: what belongs to a light that is no disc
constexpr double kRing = 1.4;     // times the outline: what is around it
// From this relative standard deviation of its distance on, a light counts as distant. Capture
// reports lights below the same limit.
constexpr double kUnsure = 0.2;
constexpr double kStep = 0.02;         // of ρ, 1 / m: from one map to the next, and
constexpr double kRelativeStep = 0.1;  // of ρ itself
constexpr double kSame = 0.1;          // radians: one light, within its radius and this
constexpr float kLeastSine = 0.01f;    // half a degree: a point would be infinitely bright up close
constexpr float kMostSine = 0.9999f;   // the centre lies outside the light

struct Place {
  glm::dvec3 direction;
  double inverse_distance, sin_radius;
};

std::optional<Place> place_of(const LightPosition& light, const glm::dvec3& centre) {
  const glm::dvec3 arrow = light.position - centre;
  const double distance = glm::length(arrow);
  const double radius = light.radius > 0 ? light.radius : 0.0;
  if (!(distance > radius) || !std::isfinite(distance)) return std::nullopt;
  const glm::dvec3 direction = arrow / distance;
  const double along = glm::dot(direction, light.covariance * direction);
  const double spread =  // across the line of sight, of each axis
      (light.covariance[0][0] + light.covariance[1][1] + light.covariance[2][2] - along) / 2;
  if (!(along >= 0) || !std::isfinite(along) || !std::isfinite(spread)) return std::nullopt;
  const double unsure = along / (kUnsure * kUnsure * distance * distance);
  if (!(unsure < 1)) return std::nullopt;
  // A light whose place is unsure by more than its radius counts as large as that.
  const double size = std::max(radius, std::sqrt(std::max(spread, 0.0))) / distance;
  return Place{direction, (1 - unsure) / distance,
               std::clamp(size, double(kLeastSine), double(kMostSine))};
}

// Limits how far lights come nearer, or go away, from one map to the next.
void approach(const NearLights& before, std::vector<Place>& places) {
  const auto step = [](double inverse) { return std::max(kStep, kRelativeStep * inverse); };
  std::vector<bool> known(before.lights.size(), false);
  for (Place& place : places) {
    double last = 0;
    double nearest = std::cos(std::asin(place.sin_radius) + kSame);
    std::size_t which = before.lights.size();
    for (std::size_t i = 0; i < before.lights.size(); ++i) {
      const double along = glm::dot(glm::dvec3(before.lights[i].direction), place.direction);
      if (along > nearest) nearest = along, which = i;
    }
    if (which < before.lights.size())
      known[which] = true, last = double(before.lights[which].inverse_distance);
    const double most = step(last);
    place.inverse_distance = std::clamp(place.inverse_distance, last - most, last + most);
  }
  for (std::size_t i = 0; i < before.lights.size(); ++i) {
    const NearLight& light = before.lights[i];
    const double left = double(light.inverse_distance) - step(double(light.inverse_distance));
    if (!known[i] && left > 0)
      places.push_back({glm::dvec3(light.direction), left, double(light.sin_radius)});
  }
}

// The light around a direction, and where it is taken from.
struct Texel {
  int face, x, y;
  glm::dvec3 direction;
  double solid_angle;
};

class Search {
 public:
  explicit Search(const CubeLevel& level)
      : level_(level),
        size_(level.size()),
        angles_(texel_solid_angles(size_)),
        taken_(std::size_t(6) * std::size_t(size_) * std::size_t(size_), glm::vec3(0)) {}

  NearLight light(const Place& place) {
    const double outline = std::min(
        kOutline * std::asin(place.sin_radius) + kTexels * (kPi / 2) / size_, double(kPi) / 2);
    find(place.direction, outline);
    const glm::vec3 around = median();
    glm::dvec3 vector(0);
    for (const Texel& t : inside_) {
      const glm::dvec3 flux = t.solid_angle * glm::dvec3(excess(t, around));
      vector += (flux.x + flux.y + flux.z) * t.direction;
    }
    NearLight light;
    const double length = glm::length(vector);
    if (!(length > 0)) return light;
    const glm::dvec3 middle = vector / length;
    glm::dvec3 irradiance(0);
    for (const Texel& t : inside_) {
      const glm::vec3 own = excess(t, around);
      irradiance += t.solid_angle * std::max(glm::dot(t.direction, middle), 0.0) * glm::dvec3(own);
      taken_[index(t)] += own;
    }
    light.direction = glm::vec3(middle);
    light.inverse_distance = float(place.inverse_distance);
    light.sin_radius = float(place.sin_radius);
    light.irradiance = glm::vec3(irradiance);
    light.around = around;
    return light;
  }

 private:
  std::size_t index(const Texel& t) const {
    return std::size_t((t.face * size_ + t.y) * size_ + t.x);
  }
  glm::vec3 excess(const Texel& t, glm::vec3 around) const {
    return glm::max(level_.texel(t.face, t.x, t.y) - taken_[index(t)] - around, glm::vec3(0));
  }
  void find(const glm::dvec3& direction, double outline) {
    inside_.clear(), ring_.clear();
    const double inner = std::cos(outline),
                 outer = std::cos(std::min(kRing * outline, double(kPi)));
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < size_; ++y)
        for (int x = 0; x < size_; ++x) {
          const glm::dvec3 d(texel_direction(f, x, y, size_));
          const double along = glm::dot(d, direction), length = glm::length(d);
          if (along < outer * length) continue;
          const Texel t{f, x, y, d / length, angles_[std::size_t(y * size_ + x)]};
          (along < inner * length ? ring_ : inside_).push_back(t);
        }
  }
  // Median of the ring by channel: another light in it counts by its size alone.
  glm::vec3 median() const {
    glm::vec3 out(0);
    if (ring_.empty()) return out;
    std::vector<float> values(ring_.size());
    for (int c = 0; c < 3; ++c) {
      for (std::size_t i = 0; i < ring_.size(); ++i)
        values[i] = level_.texel(ring_[i].face, ring_[i].x, ring_[i].y)[c];
      const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      out[c] = *middle;
    }
    return out;
  }

  const CubeLevel& level_;
  int size_;
  std::vector<double> angles_;
  std::vector<glm::vec3> taken_;
  std::vector<Texel> inside_, ring_;
};

}  // namespace

NearLights find_near_lights(const Environment& environment, const NearLights* before) {
  NearLights out;
  out.centre = glm::vec3(environment.centre);
  std::vector<Place> places;
  for (const LightPosition& light : environment.light_positions)
    if (const auto place = place_of(light, environment.centre)) places.push_back(*place);
  if (before && before->centre == out.centre) approach(*before, places);
  if (places.empty() || environment.radiance.size() == 0) return out;
  Search search(environment.radiance.level_at_most(kWorkSize));
  for (const Place& place : places) {
    const NearLight light = search.light(place);
    if (light.irradiance != glm::vec3(0)) out.lights.push_back(light);
  }
  return out;
}

CubeMap near_radiance(const CubeMap& map, const NearLights& near_lights) {
  CubeMap out(map.size());
  const CubeLevel& from = map.level(0);
  CubeLevel& to = out.base();
  parallel_for(6 * map.size(), 16, [&](int begin, int end) {
    for (int row = begin; row < end; ++row)
      for (int f = row / map.size(), y = row % map.size(), x = 0; x < map.size(); ++x) {
        const glm::vec3 d = glm::normalize(texel_direction(f, x, y, map.size()));
        if (const NearLight* light = near_lights.towards(d))
          to.texel(f, x, y) = glm::max(from.texel(f, x, y) - light->around, 0.0f);
      }
  });
  out.update();
  return out;
}

}  // namespace fastibl
