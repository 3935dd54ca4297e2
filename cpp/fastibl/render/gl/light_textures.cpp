#include "fastibl/render/gl/light_textures.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "fastibl/core/check.h"
#include "fastibl/render/gl/half_scale.h"

namespace fastibl {
namespace {

constexpr int kBakedSize = 32;  // texels along a face, for a method that is no cube map itself
constexpr int kBaked = 5, kLobes = 6;  // variants that read a cube map, and lobes

// Uploads a rectangle into level k of the bound cube map. fits: that level has its size already;
// otherwise the rectangle is its whole face.
void upload_rect(const Gpu& gpu, const CubeLevel& level, const FaceRect& r, int k, float scale,
                 bool fits) {
  const int width = r.width(), height = r.y1 - r.y0;
  std::vector<glm::vec4> texels(std::size_t(r.texels()));
  glm::vec4* to = texels.data();
  for (int y = r.y0; y < r.y1; ++y) {
    const glm::vec3* from = &level.texel(r.face, r.x0, y);
    for (int x = 0; x < width; ++x) *to++ = glm::vec4(scale * from[x], 1);
  }
  const GLenum face = GLenum(GL_TEXTURE_CUBE_MAP_POSITIVE_X + r.face);
  if (fits)
    glTexSubImage2D(face, k, r.x0, r.y0, width, height, GL_RGBA, GL_FLOAT, texels.data());
  else
    glTexImage2D(face, k, gpu.half() ? GL_RGBA16F : GL_RGBA32F, width, height, 0, GL_RGBA, GL_FLOAT,
                 texels.data());
}

void upload_level(const Gpu& gpu, const CubeLevel& level, int k, float scale, bool fits) {
  for (int f = 0; f < 6; ++f)
    upload_rect(gpu, level, {f, 0, 0, level.size(), level.size()}, k, scale, fits);
}

float largest_value(const CubeMap& map) {
  float largest = 0;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < map.size(); ++y) {
      const glm::vec3* row = &map.level(0).texel(f, 0, y);
      for (int x = 0; x < map.size(); ++x)
        largest = std::max({largest, row[x].x, row[x].y, row[x].z});
    }
  return largest;
}

// On each face, a rectangle around the tiles whose versions differ; empty where none does.
std::array<FaceRect, 6> changed_rects(const CubeMap& map,
                                      const std::vector<std::uint64_t>& versions) {
  std::array<FaceRect, 6> rects;
  for (int f = 0; f < 6; ++f) rects[std::size_t(f)] = {f, map.size(), map.size(), 0, 0};
  for (int tile = 0; tile < map.tiles().count(); ++tile) {
    if (!versions.empty() && versions[std::size_t(tile)] == map.tile_version(tile)) continue;
    const FaceRect t = tile_rect(map.tiles(), tile);
    FaceRect& r = rects[std::size_t(t.face)];
    r = {t.face, std::min(r.x0, t.x0), std::min(r.y0, t.y0), std::max(r.x1, t.x1),
         std::max(r.y1, t.y1)};
  }
  return rects;
}

// The texels of a level of size m that a rectangle of the first level, of size n, has a part in.
// Levels of an odd size share texels with their neighbours.
FaceRect on_level(const FaceRect& r, int n, int m) {
  const int margin = (n & (n - 1)) == 0 ? 0 : 1;
  const auto low = [&](int i) { return std::max(0, int(std::int64_t(i) * m / n) - margin); };
  const auto high = [&](int i) {
    return std::min(m, int((std::int64_t(i) * m + n - 1) / n) + margin);
  };
  return {r.face, low(r.x0), low(r.y0), high(r.x1), high(r.y1)};
}

}  // namespace

void LightTextures::upload_radiance(Gpu& gpu, const std::shared_ptr<const CubeMap>& map) {
  check(map && map->size() > 0, "the radiance map is empty");
  gpu.check_face(map->size());
  // The scale is a power of two, so it seldom changes; when it does, so do all stored values.
  const float scale = gpu.half() ? half_scale(largest_value(*map)) : 1.0f;
  const bool fits = radiance_size_ == map->size();
  const bool follows = fits && scale == radiance_scale_;
  const std::array<FaceRect, 6> rects =
      changed_rects(*map, follows ? radiance_versions_ : std::vector<std::uint64_t>{});
  glActiveTexture(GL_TEXTURE0);
  if (!cube_.id) cube_.id = gpu.new_texture();
  glBindTexture(GL_TEXTURE_CUBE_MAP, cube_.id);
  radiance_versions_.clear();  // until the upload is complete
  for (int k = 0; k < map->level_count(); ++k)
    for (const FaceRect& rect : rects)
      if (rect.x0 < rect.x1)
        upload_rect(gpu, map->level(k), on_level(rect, map->size(), map->level(k).size()), k,
                    1 / scale, fits);
  set_sampling(GL_TEXTURE_CUBE_MAP, GL_LINEAR, GL_LINEAR_MIPMAP_NEAREST);
  glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAX_LEVEL, map->level_count() - 1);
  radiance_size_ = map->size(), radiance_levels_ = map->level_count(), radiance_scale_ = scale;
  radiance_versions_.assign(map->tile_versions().begin(), map->tile_versions().end());
}

void LightTextures::upload_sampled(Gpu& gpu, const Lighting& lighting) {
  upload_radiance(gpu, lighting.radiance);
  const std::shared_ptr<const CubeMap>& map = lighting.near_radiance;
  if (!map || (map == near_map_ && near_scale_ == radiance_scale_)) return;
  glActiveTexture(GL_TEXTURE0);
  if (!near_.id) near_.id = gpu.new_texture();
  glBindTexture(GL_TEXTURE_CUBE_MAP, near_.id);
  const bool fits = near_map_ && near_map_->size() == map->size();
  near_map_.reset();  // until the upload is complete
  for (int k = 0; k < map->level_count(); ++k)
    upload_level(gpu, map->level(k), k, 1 / radiance_scale_, fits);
  set_sampling(GL_TEXTURE_CUBE_MAP, GL_LINEAR, GL_LINEAR_MIPMAP_NEAREST);
  glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAX_LEVEL, map->level_count() - 1);
  near_map_ = map, near_scale_ = radiance_scale_;
}

void LightTextures::upload_chain(Gpu& gpu, const std::shared_ptr<const GlossyChain>& chain) {
  check(chain && chain->map, "the glossy chain is missing");
  upload_radiance(gpu, chain->map);
  if (chain == chain_) return;
  glActiveTexture(GL_TEXTURE0);
  const bool fits = chain_ && chain_->exact == chain->exact;  // the textures' sizes depend on it
  if (!lobes_.id) lobes_.id = gpu.new_texture(), first_lobe_.id = gpu.new_texture();
  glBindTexture(GL_TEXTURE_CUBE_MAP, first_lobe_.id);
  upload_level(gpu, chain->level(1), 0, 1 / radiance_scale_, fits);
  set_sampling(GL_TEXTURE_CUBE_MAP, GL_LINEAR, GL_LINEAR);
  glBindTexture(GL_TEXTURE_CUBE_MAP, lobes_.id);
  constexpr int kFirst = 2, kLast = GlossyChain::kLevelCount - 1;
  for (int k = kFirst; k <= kLast; ++k)
    upload_level(gpu, chain->level(k), k - kFirst, 1 / radiance_scale_, fits);
  set_sampling(GL_TEXTURE_CUBE_MAP, GL_LINEAR, GL_LINEAR_MIPMAP_NEAREST);
  glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAX_LEVEL, kLast - kFirst);
  chain_ = chain;
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
  baked_scale_ = gpu.half() ? half_scale(largest) : 1.0f;
  for (glm::vec4& t : texels) t /= baked_scale_;
  if (texels == baked_texels_) return;
  const bool fits = baked_.id && texels.size() == baked_texels_.size();
  baked_texels_.clear();  // until they are uploaded
  glActiveTexture(GL_TEXTURE0);
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
  baked_texels_ = std::move(texels);
}

void LightTextures::bind_radiance(Gpu& gpu, const Program& p) const {
  gpu.bind("radiance", cube_, GL_TEXTURE_CUBE_MAP);
  glUniform1f(p.uniform("radiance_scale"), radiance_scale_);
  glUniform1f(p.uniform("top_level"), float(radiance_levels_ - 1));
}

void LightTextures::bind_sampled(Gpu& gpu, const Program& p, const Lighting& lighting) const {
  bind_radiance(gpu, p);
  glUniform1i(p.uniform("taps"), lighting.glossy_settings.taps);
  glUniform1f(p.uniform("face_size"), float(lighting.radiance->size()));
  // A sampler needs a texture of its kind even where none is read.
  gpu.bind("near_radiance", lighting.near_radiance ? near_ : cube_, GL_TEXTURE_CUBE_MAP);
  std::vector<glm::vec4> places;
  if (lighting.near_radiance)
    for (const NearLight& light : lighting.near_lights.lights)
      places.emplace_back(light.direction, light.inverse_distance);
  const int count = int(std::min(places.size(), kMostSampledNear));
  glUniform1i(p.uniform("near_count"), count);
  if (count > 0) glUniform4fv(p.uniform("near_places"), count, &places[0].x);
}

void LightTextures::bind_chain(Gpu& gpu, const Program& p, const GlossyLobe& lobe,
                               const Lighting& lighting) {
  constexpr int n = GlossyLobe::kColumns, taps = GlossyLobe::kMaxTaps;
  std::vector<glm::vec4> table(std::size_t(n) * (taps + 3));
  for (int c = 0; c < n; ++c) {
    const GlossyLobe::Column& column = lobe.columns[std::size_t(c)];
    for (int k = 0; k < taps; ++k) table[std::size_t(k * n + c)] = column.taps[std::size_t(k)];
    table[std::size_t(taps * n + c)] = glm::vec4(column.direction, column.log_integral, 0);
    table[std::size_t((taps + 1) * n + c)] = column.bands;
    table[std::size_t((taps + 2) * n + c)] = column.spreads;
  }
  gpu.allocate(table_, GL_RGBA32F, n, taps + 3, GL_RGBA, GL_FLOAT, table.data());
  glUseProgram(p.id());
  gpu.bind("lobe_table", table_);
  glUniform1i(p.uniform("taps"), lobe.taps);
  glUniform1f(p.uniform("exponent"), lobe.exponent);
  glUniform1f(p.uniform("harmonics_share"), lobe.harmonics);
  glUniform3fv(p.uniform("harmonics"), 25, &chain_->harmonics[0].x);
  bind_lobes(gpu, p, lighting);
}

void LightTextures::bind_lobes(Gpu& gpu, const Program& p, const Lighting& lighting) const {
  bind_radiance(gpu, p);
  gpu.bind("chain", lobes_, GL_TEXTURE_CUBE_MAP);
  gpu.bind("first_lobe", first_lobe_, GL_TEXTURE_CUBE_MAP);
  const LightArrays lights = arrays_of(lighting);
  std::array<glm::vec4, kMaxLights> places, fluxes;
  for (int i = 0; i < kMaxLights; ++i) {
    places[std::size_t(i)] = {lights.x[i], lights.y[i], lights.z[i], lights.variance[i]};
    fluxes[std::size_t(i)] = {lights.red[i], lights.green[i], lights.blue[i], lights.level[i]};
  }
  glUniform1i(p.uniform("light_count"), lights.count);
  glUniform4fv(p.uniform("light_place"), kMaxLights, &places[0].x);
  glUniform4fv(p.uniform("light_flux"), kMaxLights, &fluxes[0].x);
  glUniform1fv(p.uniform("light_distance"), kMaxLights, lights.inverse_distance);
}

int irradiance_variant(const Gpu& gpu, DiffuseMethod method) {
  if (gpu.bake_all()) return kBaked;
  switch (method) {
    case DiffuseMethod::nearest_face:
      return 1;
    case DiffuseMethod::six_face:
      return 2;
    case DiffuseMethod::six_face_exact:
      return 3;
    case DiffuseMethod::sh9:
      return 4;
    case DiffuseMethod::sh9_lobes:
      return kLobes;
    default:
      return kBaked;
  }
}

void LightTextures::set_irradiance(Gpu& gpu, const Program& p, int variant, const Irradiance& e) {
  if (variant == kBaked) {
    upload_baked(gpu, e);
    gpu.bind("baked", baked_, GL_TEXTURE_CUBE_MAP);
    glUniform1f(p.uniform("baked_scale"), baked_scale_);
  } else if (variant == kLobes) {
    glUniform3fv(p.uniform("light"), 9, &e.polynomial[0].x);
    glUniform3fv(p.uniform("lobes"), kMostLobes, &e.lobes.axes[0].x);
    glUniform2i(p.uniform("lobe_counts"), e.lobes.counts[0], e.lobes.count());
    glUniform3fv(p.uniform("lobe_colours"), 2, &e.lobes.colours[0].x);
  } else if (e.method == DiffuseMethod::sh9) {
    glUniform3fv(p.uniform("light"), 9, &e.polynomial[0].x);
  } else {
    glUniform3fv(p.uniform("light"), 6, &e.faces[0].x);
  }
}

}  // namespace fastibl
