#include "fastibl/render/gl/material_textures.h"

#include <algorithm>

#include "fastibl/render/gl/half_scale.h"

namespace fastibl {
namespace {

constexpr const char* kNames[] = {"base_color_map", "metallic_map", "roughness_map", "emission_map",
                                  "normal_map"};
constexpr std::size_t kEmission = 3;
constexpr float kHalfMax = 65504;

// A new texture each time: its size and channels may differ from before.
GLuint make(Gpu& gpu, const SurfaceTexture& map, float unit) {
  const GLuint id = gpu.new_texture();
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D, id);
  const bool colour = map.channels() == 3;
  std::vector<float> values;
  for (int k = 0; k < map.level_count(); ++k) {
    const Image<float>& level = map.level(k);
    values.resize(level.data.size());
    std::transform(level.data.begin(), level.data.end(), values.begin(),
                   [&](float v) { return std::clamp(v / unit, -kHalfMax, kHalfMax); });
    glTexImage2D(GL_TEXTURE_2D, k, colour ? GL_RGB16F : GL_R16F, level.width, level.height, 0,
                 colour ? GL_RGB : GL_RED, GL_FLOAT, values.data());
  }
  set_sampling(GL_TEXTURE_2D, GL_LINEAR, GL_LINEAR_MIPMAP_NEAREST);
  constexpr GLint kWraps[] = {GL_REPEAT, GL_CLAMP_TO_EDGE, GL_MIRRORED_REPEAT};
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, kWraps[std::size_t(map.wraps()[0])]);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, kWraps[std::size_t(map.wraps()[1])]);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, map.level_count() - 1);
  return id;
}

}  // namespace

float MaterialTextures::emission_unit() const {
  const std::shared_ptr<const SurfaceTexture>& map = maps_[kEmission].shown;
  if (!map) return 1;
  const glm::vec3 most = map->largest();
  return half_scale(std::max({most.x, most.y, most.z}));
}

void MaterialTextures::upload(Gpu& gpu, const Material& material) {
  const PbrMaterial& m = *material.pbr;
  const std::shared_ptr<const SurfaceTexture> maps[] = {
      m.base_color_map, m.metallic_map, m.roughness_map, m.emission_map, m.normal_map};
  for (std::size_t i = 0; i < kMaps; ++i) {
    if (maps_[i].shown == maps[i]) continue;
    gpu.remove(maps_[i].texture);
    maps_[i] = {};
    if (!maps[i]) continue;
    gpu.check_size(maps[i]->width(), maps[i]->height());
    maps_[i].shown = maps[i];
    const float unit = i == kEmission ? emission_unit() : 1.0f;
    maps_[i].texture = {make(gpu, *maps[i], unit), maps[i]->width(), maps[i]->height()};
  }
  if (table_ == material.albedo) return;
  const int rows = GgxAlbedo::kRoughnesses * material.albedo->azimuths();
  if (albedo_.height != rows) gpu.remove(albedo_);
  gpu.allocate(albedo_, GL_RG32F, GgxAlbedo::kCosines, rows, GL_RG, GL_FLOAT,
               material.albedo->values().data());
  table_ = material.albedo;
}

void MaterialTextures::bind(Gpu& gpu, const Program& p) const {
  for (std::size_t i = 0; i < kMaps; ++i) {
    if (!maps_[i].shown) continue;
    gpu.bind(kNames[i], maps_[i].texture);
  }
  gpu.bind("ggx_albedo", albedo_);
  glUniform1i(p.uniform("albedo_azimuths"), table_->azimuths());
}

}  // namespace fastibl
