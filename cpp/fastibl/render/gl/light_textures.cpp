#include "fastibl/render/gl/light_textures.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

constexpr int kBakedSize = 32;  // texels along a face of a method that is no cube map itself
constexpr float kHalfMax = 32768;

// What stored values are multiplied with, so that the largest one fits half floats.
float scale_for(float largest) {
  if (!(largest > 0)) return 1;
  // A scale below this has an inverse that overflows; such light is black on any picture.
  return std::max(std::exp2(std::ceil(std::log2(largest / kHalfMax))), 1e-30f);
}

}  // namespace

void LightTextures::upload_radiance(Gpu& gpu, const std::shared_ptr<const CubeMap>& map) {
  check(map && map->size() > 0, "the radiance map is empty");
  if (map == radiance_) return;
  float largest = 0;
  if (gpu.half())
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < map->size(); ++y)
        for (int x = 0; x < map->size(); ++x) {
          const glm::vec3& t = map->level(0).texel(f, x, y);
          largest = std::max({largest, t.x, t.y, t.z});
        }
  radiance_scale_ = scale_for(largest);
  glActiveTexture(GL_TEXTURE0);
  if (!cube_.id) cube_.id = gpu.new_texture();
  glBindTexture(GL_TEXTURE_CUBE_MAP, cube_.id);
  std::vector<glm::vec4> texels;
  const float inverse = 1 / radiance_scale_;
  const bool fits = radiance_ && radiance_->size() == map->size();
  for (int k = 0; k < map->level_count(); ++k) {
    const CubeLevel& level = map->level(k);
    const int n = level.size();
    texels.resize(std::size_t(n) * std::size_t(n));
    for (int f = 0; f < 6; ++f) {
      glm::vec4* to = texels.data();
      for (int y = 0; y < n; ++y) {
        const glm::vec3* from = &level.texel(f, 0, y);
        for (int x = 0; x < n; ++x) *to++ = glm::vec4(inverse * from[x], 1);
      }
      const GLenum face = GLenum(GL_TEXTURE_CUBE_MAP_POSITIVE_X + f);
      if (fits)
        glTexSubImage2D(face, k, 0, 0, n, n, GL_RGBA, GL_FLOAT, texels.data());
      else
        glTexImage2D(face, k, gpu.half() ? GL_RGBA16F : GL_RGBA32F, n, n, 0, GL_RGBA, GL_FLOAT,
                     texels.data());
    }
  }
  set_sampling(GL_TEXTURE_CUBE_MAP, GL_LINEAR, GL_LINEAR_MIPMAP_NEAREST);
  glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAX_LEVEL, map->level_count() - 1);
  radiance_ = map;
}

void LightTextures::upload_baked(Gpu& gpu, const Irradiance& irradiance) {
  const CubeLevel* cube = irradiance.cube.get();
  const int n = cube ? cube->size() : kBakedSize;
  std::vector<glm::vec4> texels;
  float largest = 0;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const glm::vec3 e = cube
                                ? cube->texel(f, x, y)
                                : evaluate(irradiance, glm::normalize(texel_direction(f, x, y, n)));
        largest = std::max({largest, e.x, e.y, e.z});
        texels.emplace_back(e, 1);
      }
  baked_scale_ = gpu.half() ? scale_for(largest) : 1.0f;
  for (glm::vec4& t : texels) t /= baked_scale_;
  glActiveTexture(GL_TEXTURE0);
  const bool fits = baked_.id && baked_size_ == n;
  if (!baked_.id) baked_.id = gpu.new_texture();
  glBindTexture(GL_TEXTURE_CUBE_MAP, baked_.id);
  for (int f = 0; f < 6; ++f) {
    const GLenum face = GLenum(GL_TEXTURE_CUBE_MAP_POSITIVE_X + f);
    const glm::vec4* data = &texels[std::size_t(f) * std::size_t(n) * std::size_t(n)];
    if (fits)
      glTexSubImage2D(face, 0, 0, 0, n, n, GL_RGBA, GL_FLOAT, data);
    else
      glTexImage2D(face, 0, gpu.half() ? GL_RGBA16F : GL_RGBA32F, n, n, 0, GL_RGBA, GL_FLOAT, data);
  }
  set_sampling(GL_TEXTURE_CUBE_MAP, GL_LINEAR, GL_LINEAR);
  baked_size_ = n;
}

void LightTextures::bind_radiance(Gpu& gpu, const Program& p) const {
  gpu.bind("radiance", cube_, GL_TEXTURE_CUBE_MAP);
  glUniform1f(p.uniform("radiance_scale"), radiance_scale_);
  glUniform1f(p.uniform("top_level"), float(radiance_->level_count() - 1));
}

void LightTextures::bind_baked(Gpu& gpu, const Program& p) const {
  gpu.bind("baked", baked_, GL_TEXTURE_CUBE_MAP);
  glUniform1f(p.uniform("baked_scale"), baked_scale_);
}

}  // namespace fastibl
