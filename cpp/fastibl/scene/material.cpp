#include "fastibl/scene/material.h"

#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

void check_colour(const char* name, const glm::vec3& value) {
  for (int c = 0; c < 3; ++c)
    check(value[c] >= 0 && std::isfinite(value[c]), "a material's ", name,
          " must be finite and at least 0, got ", value[0], ", ", value[1], ", ", value[2]);
}

void check_share(const char* name, float value) {
  check(value >= 0 && value <= 1, "a material's ", name, " must be 0 to 1, got ", value);
}

void check_map(const char* name, const std::shared_ptr<const SurfaceTexture>& map, int channels,
               float low, float high) {
  if (!map) return;
  check(map->channels() == channels, "a material's ", name, " texture has ", channels,
        " channels, got ", map->channels());
  for (const float value : map->level(0).data)
    check(value >= low && value <= high, "a material's ", name, " texture holds ", low, " to ",
          high, ", got ", value);
}

bool same(const std::shared_ptr<const SurfaceTexture>& a,
          const std::shared_ptr<const SurfaceTexture>& b) {
  return a == b || (a && b && *a == *b);
}

}  // namespace

void PbrMaterial::validate() const {
  constexpr float kAny = 3.4e38f;
  check_colour("base_color", base_color);
  for (int c = 0; c < 3; ++c)
    check(base_color[c] <= 1, "a material's base_color must be 0 to 1, got ", base_color[c]);
  check_share("metallic", metallic);
  check_share("roughness", roughness);
  check_colour("emission", emission);
  check_share("anisotropy", anisotropy);
  check(std::isfinite(anisotropy_rotation), "a material's anisotropy_rotation must be finite, got ",
        anisotropy_rotation);
  check(std::isfinite(normal_scale), "a material's normal_scale must be finite, got ",
        normal_scale);
  check(ior == 0 || (ior >= 1 && std::isfinite(ior)),
        "a material's ior must be at least 1, or 0, got ", ior);
  check_share("specular", specular);
  check_colour("specular_color", specular_color);
  check_map("base_color", base_color_map, 3, 0, 1);
  check_map("metallic", metallic_map, 1, 0, 1);
  check_map("roughness", roughness_map, 1, 0, 1);
  check_map("emission", emission_map, 3, 0, kAny);
  check_map("normal", normal_map, 3, -1, 1);
}

glm::vec4 PbrMaterial::dielectric() const {
  const float ratio = (ior - 1) / (ior + 1);
  return {glm::min(ratio * ratio * specular_color, 1.0f), specular};
}

bool PbrMaterial::operator==(const PbrMaterial& o) const {
  return base_color == o.base_color && metallic == o.metallic && roughness == o.roughness &&
         emission == o.emission && anisotropy == o.anisotropy &&
         anisotropy_rotation == o.anisotropy_rotation && normal_scale == o.normal_scale &&
         ior == o.ior && specular == o.specular && specular_color == o.specular_color &&
         same(base_color_map, o.base_color_map) && same(metallic_map, o.metallic_map) &&
         same(roughness_map, o.roughness_map) && same(emission_map, o.emission_map) &&
         same(normal_map, o.normal_map);
}

Material Material::make_pbr(const PbrMaterial& pbr) {
  pbr.validate();
  Material material;
  material.pbr = std::make_shared<const PbrMaterial>(pbr);
  material.albedo = GgxAlbedo::of(pbr.anisotropy);
  return material;
}

void Material::validate() const {
  if (pbr) {
    pbr->validate();
    check(albedo != nullptr, "a pbr material is made with Material::make_pbr");
    return;
  }
  check_colour("diffuse", diffuse);
  check_colour("glossy", glossy);
  check_colour("emission", emission);
  check(exponent >= 0, "a material's exponent must be at least 0, got ", exponent);
}

bool Material::reads_irradiance() const {
  if (pbr) return pbr->base_color != glm::vec3(0) && (pbr->metallic < 1 || pbr->metallic_map);
  return diffuse != glm::vec3(0) || (glossy != glm::vec3(0) && exponent < 1);
}

std::optional<LobeShape> Material::lobe() const {
  if (!pbr)
    return glossy == glm::vec3(0) ? std::nullopt : std::optional(LobeShape{exponent, false});
  const auto mean = [](const std::shared_ptr<const SurfaceTexture>& map) {
    return map ? map->sample({0.5f, 0.5f}, float(map->level_count() - 1)) : glm::vec3(1);
  };
  const float alpha = ggx_alpha(pbr->roughness * mean(pbr->roughness_map).x, 0).x,
              metallic = pbr->metallic * mean(pbr->metallic_map).x;
  const auto grey = [](glm::vec3 colour) { return (colour.x + colour.y + colour.z) / 3; };
  const float metal = grey(pbr->base_color * mean(pbr->base_color_map)),
              other = pbr->specular * grey(pbr->dielectric());
  // Karis 2013 has 2/α² − 2, which is never below 0 either.
  return LobeShape{2 / (alpha * alpha), true, glm::mix(other, metal, metallic)};
}

bool Material::reads_radiance() const { return pbr || (glossy != glm::vec3(0) && exponent != 0); }

bool Material::operator==(const Material& o) const {
  if (pbr || o.pbr) return pbr && o.pbr && (pbr == o.pbr || *pbr == *o.pbr);
  return diffuse == o.diffuse && glossy == o.glossy && exponent == o.exponent &&
         emission == o.emission;
}

}  // namespace fastibl
