// What renderers of one's own take of a map's light.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <vector>

#include "fastibl/lighting/dominant_lights.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/lighting/prefilter.h"
#include "fastibl/scene/ggx.h"

using namespace fastibl;

namespace {

const glm::vec3 kLamp = glm::normalize(glm::vec3(0.2f, -0.4f, 0.8f));

// A speckled map with a lamp 4° wide, or as wide as texels ask for.
std::shared_ptr<Environment> room(int size) {
  CubeMap map(size);
  unsigned random = 1;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < size; ++y)
      for (int x = 0; x < size; ++x) {
        glm::vec3 speckle;
        for (int c = 0; c < 3; ++c) {
          random = random * 1664525u + 1013904223u;
          speckle[c] = 0.5f + float(random >> 8) / float(1 << 24);
        }
        const glm::vec3 d = glm::normalize(texel_direction(f, x, y, size));
        const bool lamp = glm::dot(d, kLamp) > std::cos(std::max(0.035f, 2 / float(size)));
        map.base().texel(f, x, y) = speckle * (lamp ? glm::vec3(300, 200, 100) : glm::vec3(0.1f));
      }
  map.update();
  return std::make_shared<Environment>(environment_from(std::move(map)));
}

std::shared_ptr<const CubeMap> map_of(const std::shared_ptr<Environment>& environment) {
  return {environment, &environment->radiance};
}

glm::dvec3 flux(const CubeMap& map) { return 4 * 3.14159265358979 * map.level(0).mean(); }

}  // namespace

TEST_CASE("a map without its lights and the lights hold every photon once") {
  for (const int size : {16, 64, 128, 256, 512})
    for (const GlossyMethod glossy : {GlossyMethod::automatic, GlossyMethod::mip}) {
      CAPTURE(size);
      const auto environment = room(size);
      const Lighting lighting = fit_lighting(map_of(environment), {.glossy = glossy});
      const CubeMap rest = without_lights(lighting);
      CHECK(rest.size() == std::max(size, 64));
      glm::dvec3 both = flux(rest);
      const std::vector<DominantLight> lights = dominant_lights(lighting);
      REQUIRE(!lights.empty());
      CHECK(glm::dot(lights[0].direction, kLamp) > std::cos(0.02f));
      CHECK(!lights[0].position);
      for (const DominantLight& light : lights) both += light.flux;
      const glm::dvec3 off = both / flux(environment->radiance) - 1.0;
      MESSAGE("size ", size, ": flux off by ", off.x, " ", off.y, " ", off.z);
      CHECK(glm::length(off) < 1e-5);
      float most = 0;
      int same = 0;
      for (int f = 0; f < 6; ++f)
        for (int y = 0; y < rest.size(); ++y)
          for (int x = 0; x < rest.size(); ++x) {
            most = std::max(most, rest.level(0).texel(f, x, y).x);
            same += rest.size() == size &&
                    rest.level(0).texel(f, x, y) == environment->radiance.level(0).texel(f, x, y);
          }
      CHECK(most < 0.1f * 300);  // the lamp is gone
      if (rest.size() == size) CHECK(same > 0.98 * 6 * size * size);
    }
}

TEST_CASE("lights whose place is known have it") {
  const auto environment = room(128);
  environment->centre = {0, 0, 0.1};
  LightPosition place;
  place.direction = kLamp, place.position = environment->centre + 2.0 * glm::dvec3(kLamp);
  place.radius = 0.07;
  environment->light_positions.push_back(place);
  LightingOptions options;
  options.environment = environment.get();
  const std::vector<DominantLight> lights =
      dominant_lights(fit_lighting(map_of(environment), options));
  REQUIRE(!lights.empty());
  REQUIRE(lights[0].position.has_value());
  CHECK(glm::length(glm::dvec3(*lights[0].position) - place.position) < 0.02);
}

TEST_CASE("a lighting without a map has no lights to be asked for") {
  CHECK_THROWS_AS(dominant_lights(Lighting()), std::invalid_argument);
  CHECK_THROWS_AS(without_lights(Lighting()), std::invalid_argument);
}

TEST_CASE("the DFG table holds the albedos of its texels' centres") {
  const Image<float> table = dfg_table(8);
  CHECK((table.width == 8 && table.height == 8 && table.channels == 2));
  for (int row = 0; row < 8; ++row)
    for (int column = 0; column < 8; ++column) {
      const double cosine = (column + 0.5) / 8, roughness = (row + 0.5) / 8;
      const glm::dvec2 albedo =
          integrate_ggx_albedo({0, std::sqrt(1 - cosine * cosine), cosine},
                               glm::dvec2(std::max(roughness * roughness, 0.02)));
      CHECK(std::abs(table.pixel(column, row)[0] - albedo.x) < 3e-4);
      CHECK(std::abs(table.pixel(column, row)[1] - albedo.y) < 3e-4);
    }
  CHECK(dfg_table(1).data.size() == 2);
  CHECK_THROWS_AS(dfg_table(0), std::invalid_argument);
  CHECK_THROWS_AS(dfg_table(1025), std::invalid_argument);
}

TEST_CASE("the irradiance cube and the harmonics of a map") {
  const double pi = 3.14159265358979;
  const CubeMap white(32, std::vector<glm::vec3>(std::size_t{6} * 32 * 32, glm::vec3(1, 2, 3)));
  const CubeMap cube = irradiance_cube(white, 8);
  REQUIRE(cube.size() == 8);
  CHECK(glm::length(cube.level(0).texel(3, 1, 6) / glm::vec3(1, 2, 3) - float(pi)) < 1e-5f);
  CHECK(glm::length(project_sh9(white)[0] / glm::dvec3(1, 2, 3) - 0.28209479 * 4 * pi) < 1e-5);
  // The irradiance of a map by its harmonics is what they give as a method.
  const auto environment = room(64);
  const std::array<glm::dvec3, 9> c = project_sh9(environment->radiance);
  const Lighting lighting = fit_lighting(map_of(environment), {.diffuse = DiffuseMethod::sh9});
  const glm::dvec3 e = pi * 0.282095 * c[0] + 2 * pi / 3 * 0.488603 * c[2] +
                       pi / 4 * (0.315392 * 2 * c[6]);  // towards z
  CHECK(glm::length(e / glm::dvec3(evaluate(lighting.irradiance, glm::vec3(0, 0, 1))) - 1.0) <
        1e-4);
  for (const int size : {0, 257}) {
    CHECK_THROWS_AS(irradiance_cube(white, size), std::invalid_argument);
    CHECK_THROWS_AS(irradiance_cube(white, 16, size), std::invalid_argument);
  }
  CHECK_THROWS_AS(irradiance_cube(CubeMap()), std::invalid_argument);
  CHECK_THROWS_AS(project_sh9(CubeMap()), std::invalid_argument);
}
