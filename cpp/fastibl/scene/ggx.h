// Light that a rough surface reflects: single-scattering GGX, isotropic and anisotropic.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/light_arrays.h"
#include "fastibl/scene/lighting.h"

namespace fastibl {

inline constexpr float kSmallestAlpha = 0.02f;
inline constexpr int kMostGgxTaps = 16, kGgxTaps = 8;

// GGX's alpha along tangent and bitangent, from 0.02 to 1. glTF's mapping
// (KHR_materials_anisotropy): across alpha = roughness², along it mix(roughness², 1, anisotropy²).
glm::vec2 ggx_alpha(float roughness, float anisotropy);

enum class GgxMethod {
  taps,      // parts of the lobe along its longest axis, each read with its own width
  gradient,  // what Croubois et al. 2014 suggest: texture gradients, as anisotropic filters read
             // them
  sampled,   // filtered importance sampling, any number of taps: without lights taken out
};
std::string_view name(GgxMethod method);
GgxMethod ggx_method(std::string_view name);  // throws std::invalid_argument, naming all methods
inline constexpr std::array kGgxMethods = {GgxMethod::taps, GgxMethod::gradient,
                                           GgxMethod::sampled};

struct GgxOptions {
  GgxMethod method = GgxMethod::taps;
  int taps = kGgxTaps;  // 1 to 16; of samples to kMaxSampledTaps

  // Of materials: twice as many along a brushed one's lobe, or small bright lights show each tap.
  static GgxOptions for_shading(const Lighting& lighting, float anisotropy) {
    if (lighting.glossy == GlossyMethod::sampled)
      return {GgxMethod::sampled, lighting.glossy_settings.taps};
    return {GgxMethod::taps, anisotropy > 0 ? kMostGgxTaps : kGgxTaps};
  }
};

// One look-up: unit direction and view in the frame of tangent, bitangent and normal.
struct GgxTap {
  glm::vec3 direction;
  float width;   // standard deviation of the blur along each axis, radians
  float weight;  // of all taps sum to 1
};
struct GgxTaps {
  int count = 0;
  float albedo = 0;  // the lobe's integral, as the taps saw it
  std::array<GgxTap, kMostGgxTaps> taps;
};
GgxTaps ggx_taps(glm::vec3 unit_view, glm::vec2 alpha, const GgxOptions& options);

// Orthonormal, right-handed.
struct SurfaceFrame {
  glm::vec3 tangent, bitangent, normal;
};
// Around a unit normal, with the tangent as near as can be to the given one; any where that is 0,
// along the normal or not finite.
SurfaceFrame frame_around(glm::vec3 unit_normal, glm::vec3 tangent);

// Light in the lobe D G2, parted as Schlick's Fresnel term f0 (1 − e) + e parts it, e = (1 −
// v·h)^5.
struct GgxLight {
  // Averages of the map without its lights, weighted with 1 − e and e.
  glm::vec3 front{0}, edge{0};
  float edge_share = 0;  // e in the lobe's mean
  // Of the lights that were taken out: integrals.
  glm::vec3 front_lights{0}, edge_lights{0};
  float albedo = 1;  // the lobe's integral, as its look-ups saw it

  // The average over the lobe, e aside.
  glm::vec3 mean() const {
    return glm::mix(front, edge, edge_share) + (front_lights + edge_lights) / albedo;
  }
  // Integrals over the lobe times 1 − e and e. albedo: of these two, GgxAlbedo's.
  glm::vec3 front_light(glm::vec2 albedos) const { return albedos.x * front + front_lights; }
  glm::vec3 edge_light(glm::vec2 albedos) const { return albedos.y * edge + edge_lights; }
};

// Average of the map over the lobe D G2 of a surface whose Fresnel term is 1, divided by its
// directional albedo: 1 for a constant map of radiance 1. Reads the lighting's chain and its lights
// where it has one, else the MIP levels. Keeps a pointer to the lighting.
class GgxShading {
 public:
  explicit GgxShading(const Lighting& lighting);
  explicit GgxShading(Lighting&& lighting) = delete;
  // unit_view: marker frame, surface to eye. alpha: clamped to 0.02 … 1, NaN to 0.02. position:
  // marker frame, from where its lights are seen where they are; null: all light as at the map's
  // centre. Round lobes of as many taps as usual come from a table (IsotropicTaps).
  GgxLight operator()(const SurfaceFrame& frame, glm::vec3 unit_view, glm::vec2 alpha,
                      const GgxOptions& options = {}, const glm::vec3* position = nullptr) const;
  // Round lobes of many places, in the order given: the same within 1e-5 of the brightest that a
  // lobe reads. positions: one each, or empty. Throws std::invalid_argument unless there are as
  // many of everything.
  void operator()(std::span<const glm::vec3> unit_normals, std::span<const glm::vec3> unit_views,
                  std::span<const float> alphas, std::span<const glm::vec3> positions,
                  std::span<GgxLight> out) const;

 private:
  const Lighting* lighting_;
  LightArrays lights_;
};

// Directional albedo of single scattering towards a view in the surface's frame, as the two numbers
// of the split sum: f0 x + y with Fresnel by Schlick, x + y with Fresnel 1. Quadrature, within
// 3e-4.
glm::dvec2 integrate_ggx_albedo(glm::dvec3 unit_view, glm::dvec2 alpha);

// The same from a table for one strength of anisotropy.
class GgxAlbedo {
 public:
  static constexpr int kRoughnesses = 24, kCosines = 24, kAzimuths = 9;

  explicit GgxAlbedo(float anisotropy);
  // Shared by all who ask for the same strength.
  static std::shared_ptr<const GgxAlbedo> of(float anisotropy);

  glm::vec2 sample(glm::vec3 unit_view, float roughness) const;
  // Rows of kCosines: of each roughness for the first azimuth, then the next.
  const std::vector<glm::vec2>& values() const { return values_; }
  int azimuths() const { return azimuths_; }  // 1 without anisotropy

 private:
  int azimuths_;
  std::vector<glm::vec2> values_;
};

}  // namespace fastibl
