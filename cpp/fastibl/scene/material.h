// What an object's surface does with light: Eq. 3 of the paper, or glTF's metallic-roughness model.
#pragma once

#include <memory>
#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/scene/ggx.h"
#include "fastibl/scene/texture.h"

namespace fastibl {

// glTF 2.0's metallic-roughness model with KHR_materials_anisotropy, _ior and _specular, linear
// colours. A texture's values are multiplied with the factor beside it.
struct PbrMaterial {
  glm::vec3 base_color{0.8f};
  float metallic = 0, roughness = 0.5f;
  glm::vec3 emission{0.0f};       // radiance
  float anisotropy = 0;           // strength, 0 to 1
  float anisotropy_rotation = 0;  // angle from the tangent to the rougher direction, radians
  float normal_scale = 1;         // of the normal map's x and y
  // Of what is not metal:
  float ior = 1.5f;             // index of refraction: at least 1, or 0 for a mirror
  float specular = 1;           // strength of what it reflects, 0 to 1
  glm::vec3 specular_color{1};  // factor on what it reflects along the normal
  std::shared_ptr<const SurfaceTexture> base_color_map = {}, metallic_map = {}, roughness_map = {},
                                        emission_map = {};
  // Tangent space, (x, y, z) stored as they are, y up in uv.
  std::shared_ptr<const SurfaceTexture> normal_map = {};

  bool textured() const {
    return base_color_map || metallic_map || roughness_map || emission_map || normal_map;
  }
  // What is not metal reflects along the normal, and the strength of all that it reflects.
  glm::vec4 dielectric() const;
  void validate() const;  // throws for values out of range
  bool operator==(const PbrMaterial& other) const;
};

// Roughly how a surface spreads its glossy light: the half-vector exponent of Blinn's lobe, or of
// the GGX lobe that is about as wide, with α² = 2/exponent.
struct LobeShape {
  float exponent = 64;
  bool ggx = false;
  float f0 = 1;  // mean reflectance along the normal, from which GGX grows towards the edge
};

// Reflectance of Eq. 3. Colours are linear; the object's colour is
// emission + diffuse · P_V · E/π + glossy · (normalised lobe average of the radiance).
struct Material {
  glm::vec3 diffuse{0.8f};   // k_L
  glm::vec3 glossy{0.0f};    // k_G
  float exponent = 64;       // s, half-vector (Blinn-Phong) exponent ≥ 0, may be infinite
  glm::vec3 emission{0.0f};  // radiance
  // If set, it replaces Eq. 3: the colour is emission + diffuse · P_V · E/π + reflectance ·
  // (average of the radiance over the GGX lobe), see PbrMaterial.
  std::shared_ptr<const PbrMaterial> pbr = {};
  std::shared_ptr<const GgxAlbedo> albedo = {};  // of pbr's anisotropy

  static Material make_pbr(const PbrMaterial& pbr);  // validates

  void validate() const;  // throws for negative or NaN values, or an infinite colour
  bool textured() const { return pbr && pbr->textured(); }
  bool reads_irradiance() const;          // whether it reflects diffusely; s = 0 is Lambert's law
  bool reads_radiance() const;            // whether it needs the chain that lobes are read from
  std::optional<LobeShape> lobe() const;  // if it has glossy light; textures by their mean
  bool operator==(const Material& other) const;
};

}  // namespace fastibl
