#include "demo/materials.h"

#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

Material metal(glm::vec3 color, float roughness, float anisotropy = 0) {
  PbrMaterial pbr;
  pbr.base_color = color, pbr.metallic = 1, pbr.roughness = roughness;
  pbr.anisotropy = anisotropy;
  return Material::make_pbr(pbr);
}

Material plastic(glm::vec3 color, float roughness) {
  PbrMaterial pbr;
  pbr.base_color = color, pbr.roughness = roughness;
  return Material::make_pbr(pbr);
}

using Made = Material (*)();
struct Entry {
  const char* name;
  Made make;  // called only when wanted: an anisotropic lobe's table takes a second
};
constexpr Entry kEntries[] = {{"matte",
                               [] {
                                 Material material;
                                 material.diffuse = glm::vec3(0.75f);
                                 return material;
                               }},
                              {"red-plastic",
                               [] {
                                 return plastic({0.6f, 0.03f, 0.02f}, 0.25f);
                               }},
                              {"chrome",
                               [] {
                                 return metal({0.55f, 0.56f, 0.55f}, 0.05f);
                               }},
                              {"gold",
                               [] {
                                 return metal({1.0f, 0.77f, 0.34f}, 0.25f);
                               }},
                              {"brushed-steel", [] {
                                 return metal({0.56f, 0.57f, 0.58f}, 0.35f, 0.8f);
                               }}};

}  // namespace

std::vector<std::string> material_names() {
  std::vector<std::string> names{"given"};
  for (const Entry& entry : kEntries) names.emplace_back(entry.name);
  return names;
}

Material material_named(const std::string& name, const Material& given) {
  for (const Entry& entry : kEntries)
    if (name == entry.name) return entry.make();
  check(name == "given", "no material \"", name, '"');
  return given;
}

}  // namespace fastibl::demo
