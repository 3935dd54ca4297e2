// Irradiance by surface normal, as diffuse surfaces read it.
#pragma once

#include <array>
#include <memory>
#include <span>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/methods.h"

namespace fastibl {

// Distant lights in at most two colours: E(n) += colour_g Σ max(n·axis_k, 0) over the lobes of
// group g. Most rooms need only one colour: what nine coefficients leave is 80 to 99 % of one
// colour. A lobe costs three products, a group three more.
inline constexpr int kMostLobes = 12;
struct Lobes {
  std::array<glm::vec3, kMostLobes> axes{};  // towards the light, as long as its part of the colour
  std::array<int, 2> counts{};               // lobes of each colour, one group after the other
  std::array<glm::vec3, 2> colours{};        // not negative
  float left = 0;  // RMS left by the lobes, as a share of what nine coefficients leave
  int count() const { return counts[0] + counts[1]; }
};

// A cross-fade where the method changed from one map to the next, so that the light does not jump:
// what the old method gives more than the new one, part of which is still in Irradiance::cube.
struct FadingIrradiance {
  DiffuseMethod method;  // the new one
  DiffuseSettings settings;
  std::vector<glm::vec3> rest;  // by texel of the cube
  float weight;                 // of the rest, below 1
};

// Irradiance E(n) = ∫ L(w) max(n·w, 0) dw in the form that a method produces.
struct Irradiance {
  DiffuseMethod method = DiffuseMethod::sh9;  // never `automatic`
  DiffuseSettings settings;
  std::array<glm::vec3, 6> faces{};  // mean radiance of each face; for the methods by faces
  // sh9, sh9-lobes: radiance times the cosine's coefficients times the basis constants, so that
  // E = c0 + c1 y + c2 z + c3 x + c4 xy + c5 yz + c6 (3z² − 1) + c7 xz + c8 (x² − y²).
  std::array<glm::vec3, 9> polynomial{};  // sh9-lobes: less the lobes' own part
  Lobes lobes;                            // sh9-lobes
  // irradiance-cube: E by bilinear look-ups; texels themselves are sharpened for these.
  std::shared_ptr<const CubeLevel> cube;
  std::shared_ptr<const FadingIrradiance> fading;  // of an irradiance-cube, or null
};
glm::vec3 evaluate(const Irradiance& irradiance, glm::vec3 unit_normal);  // never negative
// The same for many normals, vectorised; equal to single calls within rounding.
void evaluate(const Irradiance& irradiance, std::span<const glm::vec3> unit_normals,
              std::span<glm::vec3> results);

}  // namespace fastibl
