// Irradiance by surface normal, as diffuse surfaces read it.
#pragma once

#include <array>
#include <memory>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/methods.h"

namespace fastibl {

// Irradiance E(n) = ∫ L(w) max(n·w, 0) dw in the form that a method left it.
struct Irradiance {
  DiffuseMethod method = DiffuseMethod::sh9;  // never `automatic`
  DiffuseSettings settings;
  std::array<glm::vec3, 6> faces{};  // mean radiance of each face; of the methods by faces
  // sh9: radiance times the cosine's coefficients times the basis constants, so that
  // E = c0 + c1 y + c2 z + c3 x + c4 xy + c5 yz + c6 (3z² − 1) + c7 xz + c8 (x² − y²).
  std::array<glm::vec3, 9> polynomial{};
  std::shared_ptr<const CubeLevel> cube;  // irradiance-cube: E at the texels' directions
};
glm::vec3 evaluate(const Irradiance& irradiance, glm::vec3 unit_normal);  // never negative

}  // namespace fastibl
