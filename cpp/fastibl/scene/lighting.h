// What shading needs to know of the light, and how it is read.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

enum class DiffuseMethod {
  nearest_face,    // McGuire et al. 2013: the 1×1 MIP of the face that the normal meets
  six_face,        // Croubois et al. 2014, Eq. 8 and 9
  six_face_exact,  // Eq. 8 with W_F of Eq. 7 in closed form
  sh9,             // Ramamoorthi and Hanrahan 2001: spherical harmonics up to order 2
};
enum class GlossyMethod {
  mip,  // Eq. 2: one look-up in the MIP chain at the mirror direction
};
enum class Normalization {
  energy,  // the lobe's average: a white surface in a constant map is white
  paper,   // Eq. 3 as printed: times its directional albedo ρ(θ_v, s)
};

// All methods of a step in order of the enum; the names are the public ones ("six-face-exact").
std::string_view name(DiffuseMethod method);
std::string_view name(GlossyMethod method);
std::string_view name(Normalization normalization);
DiffuseMethod diffuse_method(
    std::string_view name);  // throws std::invalid_argument, naming all methods
GlossyMethod glossy_method(std::string_view name);
Normalization normalization(std::string_view name);
inline constexpr std::array kDiffuseMethods = {DiffuseMethod::nearest_face, DiffuseMethod::six_face,
                                               DiffuseMethod::six_face_exact, DiffuseMethod::sh9};
inline constexpr std::array kGlossyMethods = {GlossyMethod::mip};

// Irradiance E(n) = ∫ L(w) max(n·w, 0) dw in the form that a method left it.
struct Irradiance {
  DiffuseMethod method = DiffuseMethod::sh9;
  std::array<glm::vec3, 6> faces{};  // mean radiance of each face; unused by sh9
  // sh9: radiance times the cosine's coefficients times the basis constants, so that
  // E = c0 + c1 y + c2 z + c3 x + c4 xy + c5 yz + c6 (3z² − 1) + c7 xz + c8 (x² − y²).
  std::array<glm::vec3, 9> polynomial{};
};
glm::vec3 evaluate(const Irradiance& irradiance, glm::vec3 unit_normal);  // never negative

struct Lighting {
  Irradiance irradiance;
  GlossyMethod glossy = GlossyMethod::mip;
  Normalization normalization = Normalization::energy;
  std::shared_ptr<const CubeMap> radiance;  // the chain that glossy reads
  glm::vec3 plane_irradiance{0};            // E(z), summed over the map
  double irradiance_error = 0;  // relative RMS error of `irradiance`, measured on this map
};

// Radiance that a lobe of half-vector exponent s ≥ 0 reflects towards the view (surface to eye),
// both unit vectors: s = 0 is E/π, s = ∞ the mirror.
glm::vec3 evaluate_glossy(const Lighting& lighting, glm::vec3 normal, glm::vec3 view,
                          float exponent);

// ρ(θ_v, s) of Eq. 3: the share of light that (s + 8)/(8π) (n·h)^s cos θ reflects. From a 64² table
// over cos θ_v and 1/√(1 + s/8), within 0.002 of quadrature for every s.
inline constexpr int kAlbedoTableSize = 64;
const std::vector<float>&
albedo_table();  // row: exponent coordinate, column: cos θ_v, ends included
float directional_albedo(float cos_view, float exponent);

}  // namespace fastibl
