#include "fastibl/render/gl/shadow_pass.h"

#include <algorithm>
#include <vector>

#include "fastibl/shadow/scene_shadow.h"

namespace fastibl {
namespace {

constexpr int kResolution = 64;  // of the shadow map

}  // namespace

void upload(Gpu& gpu, const Image<float>& image, Texture& texture) {
  if (image.empty()) return;
  std::vector<float> rgba;
  for (std::size_t i = 0; i < image.data.size(); i += 3) {
    rgba.insert(rgba.end(), &image.data[i], &image.data[i] + 3);
    rgba.push_back(1);
  }
  gpu.allocate(texture, GL_RGBA32F, image.width, image.height, GL_RGBA, GL_FLOAT, rgba.data());
}

void ShadowPass::run(Gpu& gpu, LightTextures& light, const RenderInput& in) {
  ShadowOptions options;
  options.method = in.scene.shadow_method(in.methods.shadow);
  options.settings = in.methods.shadow_settings;
  const SphereSet spheres = in.scene.placed_spheres();
  const bool caps =
      options.method == ShadowMethod::cap_sum || options.method == ShadowMethod::cap_product;
  // A method without a shader runs on the CPU. For the others this gives the place and the size: a
  // map of 2 × 2 has border texels only, where nothing is cast.
  options.resolution = caps ? 2 : 0;
  shadow_ = caster_.cast(*in.lighting.radiance, in.lighting.plane_irradiance, in.scene, options,
                         in.lighting.near_lights);
  read_ = true;
  if (!caps) {
    upload(gpu, shadow_.ratio, ratio_);
    upload(gpu, shadow_.outer, outer_);
    upload(gpu, shadow_.fine, fine_);
    return;
  }
  light.upload_radiance(gpu, in.lighting.radiance);
  std::vector<glm::vec4> rows[2];
  const double scale = 1.0 / shadow_.extent;
  for (const glm::vec4& s : spheres) {
    const bool casts = is_sphere(s) && s.z + s.w > 0;
    if (!casts || rows[0].size() == std::size_t(gpu.largest())) continue;
    const double z = s.z * scale, r = s.w * scale;
    rows[0].emplace_back((double(s.x) - shadow_.centre.x) * scale,
                         (double(s.y) - shadow_.centre.y) * scale, z, r * r);
    rows[1].emplace_back((z - r) * (z + r), std::max(z, 0.5 * (z + r)), z < r ? 1 : 0, 0);
  }
  const int count = int(rows[0].size());
  if (count > 0) {
    rows[0].insert(rows[0].end(), rows[1].begin(), rows[1].end());
    gpu.allocate(spheres_, GL_RGBA32F, count, 2, GL_RGBA, GL_FLOAT, rows[0].data());
  }
  gpu.allocate(ratio_, GL_RGBA32F, kResolution, kResolution, GL_RGBA, GL_FLOAT);
  const Program& p =
      gpu.use("shadow", {options.method == ShadowMethod::cap_product ? "PRODUCT 1" : "PRODUCT 0"});
  light.bind_radiance(gpu, p);
  gpu.bind("spheres", spheres_);
  glm::vec3 inverse(0);
  for (int c = 0; c < 3; ++c)
    if (in.lighting.plane_irradiance[c] > kLeastIrradiance)
      inverse[c] = 1 / in.lighting.plane_irradiance[c];
  set(p, "inverse_irradiance", inverse);
  glUniform1f(p.uniform("texels"), kResolution);
  glUniform1f(p.uniform("face_size"), float(in.lighting.radiance->size()));
  glUniform1i(p.uniform("count"), count);
  gpu.target(0, ratio_);
  gpu.draw_full_screen(kResolution, kResolution);
  read_ = false;
}

const ShadowMap& ShadowPass::shadow_map(Gpu& gpu) {
  if (!read_) {
    const Gpu::Scope scope(gpu);
    const Image<float> pixels = gpu.read(ratio_, kResolution, kResolution);
    shadow_.ratio = Image<float>(kResolution, kResolution, 3);
    for (std::size_t i = 0; i < shadow_.ratio.data.size(); ++i)
      shadow_.ratio.data[i] = pixels.data[i / 3 * 4 + i % 3];
    read_ = true;
  }
  return shadow_;
}

}  // namespace fastibl
