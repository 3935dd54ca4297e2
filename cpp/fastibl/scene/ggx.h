// Light that a rough surface reflects: single-scattering GGX, isotropic and anisotropic.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/light_arrays.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

inline constexpr float kSmallestAlpha = 0.02f;
inline constexpr int kMostGgxTaps = 16, kGgxTaps = 8;

// GGX's alpha along tangent and bitangent, from 0.02 to 1. glTF's mapping
// (KHR_materials_anisotropy): across alpha = roughness², along it mix(roughness², 1, anisotropy²).
glm::vec2 ggx_alpha(float roughness, float anisotropy);

enum class GgxMethod {
  taps,      // parts of the lobe along its longest axis, each read with its own width
  gradient,  // texture gradients, read as anisotropic filters do: suggested by Croubois et al. 2014
  sampled,   // filtered importance sampling, any number of taps: without lights taken out
};
std::string_view name(GgxMethod method);
GgxMethod ggx_method(std::string_view name);  // throws std::invalid_argument, naming all methods
inline constexpr std::array kGgxMethods = {GgxMethod::taps, GgxMethod::gradient,
                                           GgxMethod::sampled};

struct GgxOptions {
  GgxMethod method = GgxMethod::taps;
  int taps = kGgxTaps;  // 1 to 16; for `sampled` up to kMaxSampledTaps

  // For shading a material: a brushed one gets twice as many taps along its lobe, because small
  // bright lights would otherwise show each tap.
  static GgxOptions for_shading(const Lighting& lighting, float anisotropy) {
    if (lighting.glossy == GlossyMethod::sampled)
      return {GgxMethod::sampled, lighting.glossy_settings.taps};
    return {GgxMethod::taps, anisotropy > 0 ? kMostGgxTaps : kGgxTaps};
  }
};

// One look-up. Directions and views are unit vectors in the frame of tangent, bitangent and normal.
struct GgxTap {
  glm::vec3 direction;
  float width;   // standard deviation of the blur along each axis, radians
  float weight;  // the weights of all taps sum to 1
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
// The frame around a unit normal whose tangent is as near as possible to the given one. The tangent
// is arbitrary where the given one is 0, along the normal or not finite.
SurfaceFrame frame_around(glm::vec3 unit_normal, glm::vec3 tangent);

// Light in the lobe D G2, split as Schlick's Fresnel term f0 (1 − e) + e splits it, with
// e = (1 − v·h)^5.
struct GgxLight {
  // Averages of the map without its lights, weighted with 1 − e and e.
  glm::vec3 front{0}, edge{0};
  float edge_share = 0;  // mean of e over the lobe
  // Integrals of the lights that were taken out.
  glm::vec3 front_lights{0}, edge_lights{0};
  float albedo = 1;  // the lobe's integral, as its look-ups saw it

  // The average over the lobe, without regard to e.
  glm::vec3 mean() const {
    return glm::mix(front, edge, edge_share) + (front_lights + edge_lights) / albedo;
  }
  // Integrals over the lobe times 1 − e and times e. albedos: GgxAlbedo's two numbers.
  glm::vec3 front_light(glm::vec2 albedos) const { return albedos.x * front + front_lights; }
  glm::vec3 edge_light(glm::vec2 albedos) const { return albedos.y * edge + edge_lights; }
};

// Average of the map over the lobe D G2 of a surface whose Fresnel term is 1, divided by the
// surface's directional albedo: 1 for a constant map of radiance 1. Reads the lighting's chain and
// the chain's lights if there is a chain, else the MIP levels. Keeps a pointer to the lighting.
class GgxShading {
 public:
  explicit GgxShading(const Lighting& lighting);
  explicit GgxShading(Lighting&& lighting) = delete;
  // unit_view: marker frame, from surface to eye. alpha: clamped to 0.02 … 1, NaN to 0.02.
  // position: marker frame; from there near lights are seen where they are. Null: all light is as
  // at the map's centre. Round lobes with the default number of taps come from a table
  // (IsotropicTaps).
  GgxLight operator()(const SurfaceFrame& frame, glm::vec3 unit_view, glm::vec2 alpha,
                      const GgxOptions& options = {}, const glm::vec3* position = nullptr) const;
  // Round lobes at many places, results in the order given: the same within 1e-5 of the brightest
  // value that a lobe reads. positions: one for each place, or empty. Throws std::invalid_argument
  // unless all spans have the same length.
  void operator()(std::span<const glm::vec3> unit_normals, std::span<const glm::vec3> unit_views,
                  std::span<const float> alphas, std::span<const glm::vec3> positions,
                  std::span<GgxLight> out) const;

 private:
  const Lighting* lighting_;
  LightArrays lights_;
  std::optional<WallsAround> walls_;  // where they are known
};

// Directional albedo of single scattering towards a view in the surface's frame, as the two numbers
// x and y of the split sum: it is f0 x + y with Schlick's Fresnel term, and x + y with a Fresnel
// term of 1. By quadrature, within 1e-4, and 6e-4 where the alphas differ.
glm::dvec2 integrate_ggx_albedo(glm::dvec3 unit_view, glm::dvec2 alpha);

// The same of round lobes, as the texture that renderers multiply a prefiltered map by: the DFG
// table of the split sum (Karis 2013). Two channels, x and y; the reflectance is f0 x + y. The
// texel in column i and row j is at n · v = (i + ½)/size and perceptual roughness (j + ½)/size,
// whose square is alpha, at least kSmallestAlpha: look it up bilinearly at (n · v, roughness),
// clamped to its edge. A 64² table takes half a second of one core. Throws std::invalid_argument
// for a size outside of 1 to 1024.
Image<float> dfg_table(int size = 64);

// integrate_ggx_albedo() from a table for one strength of anisotropy.
class GgxAlbedo {
 public:
  static constexpr int kRoughnesses = 24, kCosines = 24, kAzimuths = 9;

  explicit GgxAlbedo(float anisotropy);
  // The table of a strength of anisotropy, shared by all callers.
  static std::shared_ptr<const GgxAlbedo> of(float anisotropy);

  glm::vec2 sample(glm::vec3 unit_view, float roughness) const;
  // Rows of kCosines values: one for each roughness at the first azimuth, then at the next.
  const std::vector<glm::vec2>& values() const { return values_; }
  int azimuths() const { return azimuths_; }  // 1 without anisotropy

 private:
  int azimuths_;
  std::vector<glm::vec2> values_;
};

}  // namespace fastibl
