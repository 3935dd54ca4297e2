#include "fastibl/render/gl/shade_pass.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "fastibl/core/check.h"
#include "fastibl/scene/directional_albedo.h"
#include "fastibl/scene/glossy.h"
#include "fastibl/scene/room_box.h"
#include "fastibl/scene/shared_formulas.h"
#include "fastibl/shading/rasterize.h"
#include "fastibl/shading/sample_cells.h"
#include "fastibl/shading/supersample.h"

namespace fastibl {
namespace {

constexpr unsigned kFirstHoldout = 0x80000000u;  // as in shade.frag.glsl

bool lit(glm::vec3 colour) { return colour != glm::vec3(0); }

// Values of GLOSSY in shade.frag.glsl; 6 to 8 are of glTF's model.
enum class GlossyVariant { none, mip, matte, chain, nearly_matte, sampled };

GlossyVariant glossy_variant(const Material& material, GlossyMethod method) {
  if (!lit(material.glossy)) return GlossyVariant::none;
  if (material.exponent == 0) return GlossyVariant::matte;
  if (method == GlossyMethod::mip) return GlossyVariant::mip;
  if (method == GlossyMethod::sampled) return GlossyVariant::sampled;
  check(method == GlossyMethod::centroid || method == GlossyMethod::stretched ||
            method == GlossyMethod::prefiltered,
        "the GL back end has no glossy method ", name(method));
  return material.exponent < 1 ? GlossyVariant::nearly_matte : GlossyVariant::chain;
}

// The holdouts, as MeshBuffers reads a scene.
Scene holdout_scene(const Scene& scene) {
  Scene real;
  real.mesh = scene.holdouts->mesh;
  real.normals = scene.holdouts->normals;
  real.visibility.assign(real.normals.size(), 1.0f);
  return real;
}

Pose camera_from_object(const RenderInput& in) {
  return in.camera_from_marker * in.scene.marker_from_object;
}

std::string colors(const Scene& scene) {
  return scene.mesh.colors.empty() ? "COLORS 0" : "COLORS 1";
}

std::string box(const Lighting& lighting) { return lighting.box ? "BOX 1" : "BOX 0"; }

// Where the map is seen from, and its box of walls.
void set_surroundings(const Program& p, const Lighting& lighting) {
  const glm::vec3 centre = lighting.near_lights.centre;
  glUseProgram(p.id());
  set(p, "map_centre", centre);
  if (!lighting.box) return;
  const WallsAround walls(*lighting.box, centre);
  set(p, "box_lower", walls.lower);
  set(p, "box_upper", walls.upper);
  glUniform2f(p.uniform("box_axis"), walls.axis.x, walls.axis.y);
}

}  // namespace

void ShadePass::run(Gpu& gpu, LightTextures& light, const RenderInput& in) {
  scale_ = in.supersampling;  // or less, where a texture could not hold the picture
  const int tiles = PixelShares::has(in.methods.self_shadow) ? 2 : 1;
  while (scale_ > 1 &&
         std::max(in.camera->width, in.camera->height) * scale_ * tiles > gpu.largest())
    --scale_;
  if (scale_ == 1) return draw(gpu, light, in);
  const Camera large = enlarged(*in.camera, scale_);
  RenderInput larger = in;
  larger.camera = &large;
  draw(gpu, light, larger);
  reduce(gpu);
}

void ShadePass::reduce(Gpu& gpu) {
  if (area_.empty()) return;
  area_ = {area_.x0 / scale_, area_.y0 / scale_, area_.x1 / scale_, area_.y1 / scale_};
  average(gpu, object_, mean_object_);
  if (has_holdout_) average(gpu, holdout_, mean_holdout_);
}

void ShadePass::average(Gpu& gpu, const Texture& large, Texture& mean) {
  gpu.allocate(mean, GL_RGBA32F, (large.width + scale_ - 1) / scale_,
               (large.height + scale_ - 1) / scale_, GL_RGBA, GL_FLOAT);
  const Program& p = gpu.use("average", {});
  glUniform1i(p.uniform("scale"), scale_);
  gpu.bind("large", large);
  gpu.target(0, mean);
  gpu.draw_full_screen(area_.width(), area_.height());
}

void ShadePass::draw(Gpu& gpu, LightTextures& light, const RenderInput& in) {
  mesh_.upload(gpu, in.scene);
  mesh_.upload_shares(gpu, in.scene, in.light_shares);
  const Outline outline = outline_of(mesh_.mesh(), *in.camera, camera_from_object(in));
  area_ = outline.area;
  has_holdout_ = in.scene.has_holdouts();
  Outline around = outline, holdout;
  if (has_holdout_) {
    const Scene real = holdout_scene(in.scene);
    holdout_mesh_.upload(gpu, real);
    holdout_mesh_.upload_shares(gpu, real, in.holdout_ratios);
    holdout = outline_of(holdout_mesh_.mesh(), *in.camera, in.camera_from_marker);
    has_holdout_ = !holdout.area.empty();
  }
  if (has_holdout_) {
    area_ = area_.united(holdout.area);
    const bool alone = outline.area.empty();
    around.nearest = alone ? holdout.nearest : std::min(outline.nearest, holdout.nearest);
    around.farthest = alone ? holdout.farthest : std::max(outline.farthest, holdout.farthest);
  }
  if (area_.empty()) return;
  // Whole pixels of the picture, which ends with one.
  area_.x0 -= area_.x0 % scale_, area_.y0 -= area_.y0 % scale_;
  area_.x1 += (scale_ - area_.x1 % scale_) % scale_;
  area_.y1 += (scale_ - area_.y1 % scale_) % scale_;
  draw_visible(gpu, in, outline, holdout, around);
  if (has_holdout_) draw_holdout(gpu, in);
  shares_by_pixel_ = pixel_shares_.find(gpu, light, parts(), in);
  gpu.allocate(object_, GL_RGBA32F, visible_.width, visible_.height, GL_RGBA, GL_FLOAT);
  if (in.scene.material.pbr)
    draw_pbr(gpu, light, in);
  else
    draw_colour(gpu, light, in);
}

// Draws which triangle each of a pixel's samples sees; each sample has one channel of the target.
void ShadePass::draw_visible(Gpu& gpu, const RenderInput& in, const Outline& outline,
                             const Outline& holdout, const Outline& around) {
  const int width = area_.width(), height = area_.height();
  // The size grows in steps, so that a moving object does not make new textures in every frame.
  const auto step = [&](int n) { return std::max(n, std::min((n + 63) / 64 * 64, gpu.largest())); };
  const int columns = std::max(step(width), visible_.width),
            rows = std::max(step(height), visible_.height);
  if (visible_.width != columns || visible_.height != rows) gpu.allocate_depth(columns, rows);
  gpu.allocate(visible_, GL_RGBA32UI, columns, rows, GL_RGBA_INTEGER, GL_UNSIGNED_INT);
  MeshBuffers::Corners own, real;
  if (!outline.area.empty())
    own = mesh_.use(gpu, *in.camera, camera_from_object(in), outline.whole);
  if (has_holdout_) real = holdout_mesh_.use(gpu, *in.camera, in.camera_from_marker, holdout.whole);
  const Program& p = gpu.use("visibility", {distortion(*in.camera)});
  glUniform4f(p.uniform("area"), float(area_.x0), float(area_.y0), float(width), float(height));
  const double n = around.nearest, f = around.farthest;
  glUniform2f(p.uniform("depth"), float((f + n) / (f - n)), float(-2 * f * n / (f - n)));
  gpu.target(0, visible_, true);
  glEnable(GL_DEPTH_TEST);
  glEnable(GL_SCISSOR_TEST);
  glViewport(0, 0, width, height);
  glScissor(0, 0, width, height);
  const GLuint nothing[4] = {};
  const GLfloat behind = 1;
  glClearBufferuiv(GL_COLOR, 0, nothing);
  const auto draw = [&](const MeshBuffers::Corners& corners, const Pose& pose, unsigned first) {
    if (corners.count == 0) return;
    set_projection(p, *in.camera, pose);
    glUniform1ui(p.uniform("first"), first);
    glBindVertexArray(corners.vertex_array);
    glDrawArrays(GL_TRIANGLES, 0, corners.count);
  };
  for (int s = 0; s < 4; ++s) {
    glColorMask(s == 0, s == 1, s == 2, s == 3);
    glClearBufferfv(GL_DEPTH, 0, &behind);
    glUniform2f(p.uniform("shift"), 0.5f - float(kSampleX[s]) / 256,
                0.5f - float(kSampleY[s]) / 256);
    draw(own, camera_from_object(in), 0);
    draw(real, in.camera_from_marker, kFirstHoldout);
  }
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_SCISSOR_TEST);
}

void ShadePass::draw_colour(Gpu& gpu, LightTextures& light, const RenderInput& in) {
  const Material& m = in.scene.material;
  const bool paper =
      in.lighting.normalization != Normalization::energy && lit(m.glossy) && m.exponent != 0;
  const GlossyVariant glossy = glossy_variant(m, in.lighting.glossy);
  const bool matte = glossy == GlossyVariant::matte || glossy == GlossyVariant::nearly_matte;
  const Irradiance& e = in.lighting.irradiance;
  const int variant = lit(m.diffuse) || matte ? irradiance_variant(gpu, e.method) : 0;
  const Program& p = gpu.use(
      "shade", {"DIFFUSE " + std::to_string(variant), "GLOSSY " + std::to_string(int(glossy)),
                paper ? "PAPER 1" : "PAPER 0", "HOLDOUT 0", by_pixel(), colors(in.scene),
                box(in.lighting), distortion(*in.camera)});
  set_surroundings(p, in.lighting);
  set(p, "emission", m.emission);
  set(p, "diffuse_albedo", m.diffuse);
  set(p, "glossy_albedo", m.glossy);
  light.set_irradiance(gpu, p, variant, e);
  switch (glossy) {
    case GlossyVariant::none:
    case GlossyVariant::matte:
      break;
    case GlossyVariant::mip:
      light.upload_radiance(gpu, in.lighting.radiance);
      glUseProgram(p.id());
      light.bind_radiance(gpu, p);
      glUniform1f(p.uniform("level"),
                  shared::mip_level(float(in.lighting.radiance->size()), m.exponent));
      break;
    case GlossyVariant::sampled:
      light.upload_sampled(gpu, in.lighting);
      glUseProgram(p.id());
      light.bind_sampled(gpu, p, in.lighting);
      glUniform1f(p.uniform("exponent"), std::min(m.exponent, 1e30f));
      if (std::isinf(m.exponent)) glUniform1i(p.uniform("taps"), 1);  // all are the mirror's
      break;
    case GlossyVariant::chain:
    case GlossyVariant::nearly_matte:
      light.upload_chain(gpu, in.lighting.chain);
      glUseProgram(p.id());
      light.bind_chain(gpu, p,
                       GlossyLobe(*in.lighting.chain, in.lighting.glossy_settings.taps,
                                  std::max(m.exponent, 1.0f)),
                       in.lighting);
  }
  if (glossy != GlossyVariant::none && glossy != GlossyVariant::matte)
    glUniform1f(p.uniform("matte_share"), std::max(1 - m.exponent, 0.0f));
  set(p, "eye", glm::vec3(in.camera_from_marker.inverse().translation));
  if (paper) {
    if (!albedo_.id)
      gpu.allocate(albedo_, GL_R32F, kAlbedoTableSize, kAlbedoTableSize, GL_RED, GL_FLOAT,
                   albedo_table().data());
    gpu.bind("albedo_table", albedo_);
    glUniform1f(p.uniform("albedo_row"), shared::albedo_coordinate(m.exponent));
    glUniform1f(p.uniform("albedo_scale"), albedo_scale(in.lighting.normalization, m.exponent));
  }
  draw_layer(gpu, p, in);
}

// The same for a pbr material.
void ShadePass::draw_pbr(Gpu& gpu, LightTextures& light, const RenderInput& in) {
  const PbrMaterial& m = *in.scene.material.pbr;
  const Irradiance& e = in.lighting.irradiance;
  const int variant = in.scene.material.reads_irradiance() ? irradiance_variant(gpu, e.method) : 0;
  const auto has = [](const char* name, bool there) {
    return name + std::string(there ? " 1" : " 0");
  };
  const bool sampled = in.lighting.glossy == GlossyMethod::sampled,
             chain = !sampled && in.lighting.chain;
  if (chain)
    light.upload_chain(gpu, in.lighting.chain);
  else if (sampled)
    light.upload_sampled(gpu, in.lighting);
  else
    light.upload_radiance(gpu, in.lighting.radiance);
  material_.upload(gpu, in.scene.material);
  const Program& p = gpu.use(
      "shade",
      {"DIFFUSE " + std::to_string(variant),
       chain     ? "GLOSSY 7"
       : sampled ? "GLOSSY 8"
                 : "GLOSSY 6",
       "PAPER 0", "HOLDOUT 0", by_pixel(), has("BASE_COLOR_MAP", m.base_color_map != nullptr),
       has("METALLIC_MAP", m.metallic_map != nullptr),
       has("ROUGHNESS_MAP", m.roughness_map != nullptr),
       has("EMISSION_MAP", m.emission_map != nullptr), has("NORMAL_MAP", m.normal_map != nullptr),
       has("ANISOTROPIC", m.anisotropy > 0), colors(in.scene), box(in.lighting),
       distortion(*in.camera)});
  set_surroundings(p, in.lighting);
  light.set_irradiance(gpu, p, variant, e);
  glUseProgram(p.id());
  if (chain)
    light.bind_lobes(gpu, p, in.lighting);
  else if (sampled)
    light.bind_sampled(gpu, p, in.lighting);
  else
    light.bind_radiance(gpu, p);
  glUniform1f(p.uniform("face_size"), float(in.lighting.radiance->size()));
  set(p, "eye", glm::vec3(in.camera_from_marker.inverse().translation));
  set(p, "base_color", m.base_color);
  set(p, "emission", material_.emission_unit() * m.emission);
  glUniform1f(p.uniform("metallic"), m.metallic);
  glUniform1f(p.uniform("roughness"), m.roughness);
  glUniform1f(p.uniform("normal_scale"), m.normal_scale);
  glUniform1f(p.uniform("anisotropy"), m.anisotropy);
  const glm::vec4 dielectric = m.dielectric();
  glUniform4fv(p.uniform("dielectric"), 1, &dielectric.x);
  glUniform2f(p.uniform("turn"), std::cos(m.anisotropy_rotation), std::sin(m.anisotropy_rotation));
  material_.bind(gpu, p);
  mesh_.bind_uvs(gpu);
  draw_layer(gpu, p, in);
}

// The holdouts' ratios, where holdouts are seen.
void ShadePass::draw_holdout(Gpu& gpu, const RenderInput& in) {
  gpu.allocate(holdout_, GL_RGBA32F, visible_.width, visible_.height, GL_RGBA, GL_FLOAT);
  const Program& p = gpu.use("shade", {"HOLDOUT 1", "DIFFUSE 0", "GLOSSY 0", "PAPER 0", "COLORS 0",
                                       "BOX 0", "BY_PIXEL 0", distortion(*in.camera)});
  constexpr float kFlat = -2;  // holdouts have no lobe, by which parts are told apart
  PixelParts{holdout_mesh_, visible_, area_}.bind(gpu, p, *in.camera, in.camera_from_marker, kFlat);
  gpu.target(0, holdout_);
  gpu.draw_full_screen(area_.width(), area_.height());
}

void ShadePass::draw_layer(Gpu& gpu, const Program& p, const RenderInput& in) {
  parts().bind(gpu, p, *in.camera, camera_from_object(in), curved_cosine(in.scene.material));
  if (shares_by_pixel_) pixel_shares_.bind(gpu, p, area_);  // in the place of the mesh's
  set(p, "marker_from_object", glm::mat3(in.scene.marker_from_object.rotation));
  set(p, "marker_from_object_shift", glm::vec3(in.scene.marker_from_object.translation));
  if (mesh_.colors() > 0) glUniform1i(p.uniform("colors"), mesh_.colors());
  gpu.target(0, object_);
  gpu.draw_full_screen(area_.width(), area_.height());
}

ObjectLayer ShadePass::layer(Gpu& gpu) const { return read(gpu, object()); }
ObjectLayer ShadePass::holdout_layer(Gpu& gpu) const {
  return has_holdout_ ? read(gpu, holdout()) : ObjectLayer{};
}

ObjectLayer ShadePass::read(Gpu& gpu, const Texture& texture) const {
  ObjectLayer layer;
  if (area_.empty()) return layer;
  Image<float> pixels;
  {
    const Gpu::Scope scope(gpu);
    pixels = gpu.read(texture, area_.width(), area_.height());
  }
  int x0 = pixels.width, y0 = pixels.height, x1 = -1, y1 = -1;  // of what is covered
  for (int y = 0; y < pixels.height; ++y)
    for (int x = 0; x < pixels.width; ++x)
      if (pixels.pixel(x, y)[3] > 0)
        x0 = std::min(x0, x), x1 = std::max(x1, x), y0 = std::min(y0, y), y1 = std::max(y1, y);
  if (x1 < 0) return layer;
  layer.x = area_.x0 + x0, layer.y = area_.y0 + y0;
  layer.rgba = Image<float>(x1 - x0 + 1, y1 - y0 + 1, 4);
  for (int y = y0; y <= y1; ++y)
    std::copy_n(pixels.pixel(x0, y), layer.rgba.width * 4, layer.rgba.row(y - y0));
  return layer;
}

}  // namespace fastibl
