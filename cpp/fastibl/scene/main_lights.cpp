#include "fastibl/scene/main_lights.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/disjoint_sets.h"

namespace fastibl {
namespace {

// Face size of the level that is searched (window bars of a degree part nothing), and of the level
// that the whole irradiance is summed over.
constexpr int kWorkSize = 64, kSumsSize = 32;
constexpr double kSamePlace = 0.05;  // radians between a light and where it was triangulated

double brightness(glm::vec3 v) { return (double(v.x) + v.y + v.z) / 3; }

struct Texels {
  int size;
  std::vector<int> at;    // of bright texels: (face size + y) size + x
  std::vector<int> name;  // of every texel: index in `at`, −1 where it is not bright

  Texels(const CubeLevel& level, double threshold) : size(level.size()) {
    name.assign(std::size_t(6 * size * size), -1);
    int i = 0;
    for (int face = 0; face < 6; ++face)
      for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x, ++i)
          if (brightness(level.texel(face, x, y)) > threshold) {
            name[std::size_t(i)] = int(at.size());
            at.push_back(i);
          }
  }
  int face(int i) const { return i / (size * size); }
  int row(int i) const { return i / size % size; }
  int column(int i) const { return i % size; }

  // Name of the texel at (x, y), which may be one beyond an edge of the face.
  int neighbour(int face, int x, int y) const {
    if (x < 0 || y < 0 || x >= size || y >= size) {
      const TexelPlace there = texel_at(texel_direction(face, x, y, size), size);
      face = there.face, x = there.x, y = there.y;
    }
    return name[std::size_t((face * size + y) * size + x)];
  }
};

DisjointSets connected(const Texels& texels) {
  DisjointSets sets(texels.at.size());
  for (std::size_t k = 0; k < texels.at.size(); ++k) {
    const int i = texels.at[k], face = texels.face(i), x = texels.column(i), y = texels.row(i);
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const int other = texels.neighbour(face, x + dx, y + dy);
        if (other >= 0) sets.join(int(k), other);
      }
  }
  return sets;
}

double irradiance_towards(const CubeLevel& level, glm::vec3 normal) {
  const int n = level.size();
  const std::vector<double> angles = texel_solid_angles(n);
  double sum = 0;
  for (int face = 0; face < 6; ++face)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const double cosine = glm::dot(glm::normalize(texel_direction(face, x, y, n)), normal);
        if (cosine > 0)
          sum += cosine * angles[std::size_t(y * n + x)] * brightness(level.texel(face, x, y));
      }
  return sum;
}

}  // namespace

std::vector<MainLight> main_lights(const CubeMap& map, const MainLightOptions& options) {
  check(options.brightness > 0 && std::isfinite(options.brightness),
        "the brightness of a main light must be positive and finite, got ", options.brightness);
  check(options.least_share > 0 && std::isfinite(options.least_share),
        "the least share of a main light must be positive and finite, got ", options.least_share);
  if (map.level_count() == 0) return {};
  const CubeLevel& level = map.level_at_most(kWorkSize);
  const glm::dvec3 mean = level.mean();
  const Texels texels(level, options.brightness * (mean.x + mean.y + mean.z) / 3);
  if (texels.at.empty()) return {};
  DisjointSets sets = connected(texels);

  struct Region {
    glm::dvec3 middle{0}, irradiance{0};
    double solid_angle = 0;
  };
  std::vector<Region> regions(texels.at.size());  // at the lowest of each set
  const std::vector<double> angles = texel_solid_angles(texels.size);
  const auto each = [&](auto&& use) {
    for (std::size_t k = 0; k < texels.at.size(); ++k) {
      const int i = texels.at[k], face = texels.face(i), x = texels.column(i), y = texels.row(i);
      use(regions[std::size_t(sets.lowest(int(k)))],
          glm::dvec3(glm::normalize(texel_direction(face, x, y, texels.size))),
          glm::dvec3(level.texel(face, x, y)), angles[std::size_t(y * texels.size + x)]);
    }
  };
  each([](Region& region, glm::dvec3 direction, glm::dvec3 radiance, double angle) {
    region.middle += (radiance.x + radiance.y + radiance.z) * angle * direction;
    region.solid_angle += angle;
  });
  for (Region& region : regions)
    if (region.solid_angle > 0) region.middle = glm::normalize(region.middle);
  each([](Region& region, glm::dvec3 direction, glm::dvec3 radiance, double angle) {
    region.irradiance += std::max(0.0, glm::dot(direction, region.middle)) * angle * radiance;
  });

  std::vector<MainLight> lights;
  const CubeLevel& coarse = map.level_at_most(kSumsSize);
  for (const Region& region : regions) {
    if (region.solid_angle == 0) continue;
    const glm::vec3 direction(region.middle), irradiance(region.irradiance);
    const double whole = irradiance_towards(coarse, direction);
    const double share = brightness(irradiance) / whole;
    if (!(share >= options.least_share)) continue;
    lights.push_back({direction, float(region.solid_angle), float(disc_radius(region.solid_angle)),
                      irradiance, float(std::min(share, 1.0)), std::nullopt});
  }
  std::stable_sort(lights.begin(), lights.end(), [](const MainLight& a, const MainLight& b) {
    return brightness(a.irradiance) > brightness(b.irradiance);
  });
  return lights;
}

std::vector<MainLight> main_lights(const Environment& environment,
                                   const MainLightOptions& options) {
  std::vector<MainLight> lights = main_lights(environment.radiance, options);
  for (const LightPosition& place : environment.light_positions) {
    const auto angle = [&](const MainLight& light) {
      return std::acos(
          std::clamp(glm::dot(glm::dvec3(light.direction), place.direction), -1.0, 1.0));
    };
    const auto nearest = std::min_element(
        lights.begin(), lights.end(),
        [&](const MainLight& a, const MainLight& b) { return angle(a) < angle(b); });
    if (nearest == lights.end()) continue;
    const double gap = angle(*nearest);
    if (gap < std::max(kSamePlace, double(nearest->angular_radius)) &&
        (!nearest->place || gap < std::acos(std::clamp(glm::dot(glm::dvec3(nearest->direction),
                                                                nearest->place->direction),
                                                       -1.0, 1.0))))
      nearest->place = place;
  }
  return lights;
}

}  // namespace fastibl
