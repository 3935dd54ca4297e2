// The irradiance of a surface in a map with constant radiance 1: π, whatever the surface's normal.
#include <fastibl/lighting/fit_lighting.h>

#include <cstdio>
#include <memory>
#include <vector>

int main() {
  const int size = 32;
  const std::vector<glm::vec3> white(6 * size * size, glm::vec3(1));
  const auto map = std::make_shared<const fastibl::CubeMap>(size, white);
  const fastibl::Lighting lighting = fastibl::fit_lighting(map);
  const glm::vec3 e = fastibl::evaluate(lighting.irradiance, glm::normalize(glm::vec3(1, 2, 3)));
  std::printf("irradiance %.5f %.5f %.5f\n", e.r, e.g, e.b);
}
