#include <optional>

#include "fastibl/core/check.h"
#include "fastibl/render/renderer.h"
#include "fastibl/shading/composite.h"
#include "fastibl/shading/glossy_shares.h"
#include "fastibl/shading/shade.h"
#include "fastibl/shading/supersample.h"
#include "fastibl/shading/traced_lights.h"
#include "fastibl/shading/traced_shares.h"
#include "fastibl/shadow/scene_shadow.h"

namespace fastibl {
namespace {

class CpuRenderer final : public Renderer {
 public:
  std::string_view backend() const override { return "cpu"; }
  bool has(SelfShadowMethod) const override { return true; }

  void run(PassId pass, const RenderInput& in) override {
    switch (pass) {
      case PassId::shadow: {
        ShadowOptions options;
        options.method = in.methods.shadow;
        options.settings = in.methods.shadow_settings;
        shadow_ = caster_.cast(*in.lighting.radiance, in.lighting.plane_irradiance, in.scene,
                               options, in.lighting.near_lights);
        plane_.reset();
        return;
      }
      case PassId::shade: {
        parts_ = {0, 0};
        if (in.supersampling == 1) {
          draw(in, *in.camera, object_, holdout_);
          return;
        }
        object_ = {}, holdout_ = {};
        ObjectLayer object, holdout;
        for (const Strip& strip : strips_of(*in.camera, in.supersampling)) {
          draw(in, strip.camera, object, holdout);
          add_strip(strip, object, object_), add_strip(strip, holdout, holdout_);
        }
        return;
      }
      case PassId::composite: {
        if (!plane_ || plane_of_ != in.plane_gain) {
          plane_.emplace(in.plane_gain ? *in.plane_gain : shadow_);
          plane_of_ = in.plane_gain;
        }
        if (!pixels_ || pixels_->camera != *in.camera) pixels_.emplace(*in.camera);
        if (in.back.empty())
          image_ = matte(in.exposure, *pixels_, in.camera_from_marker, object_, *plane_, holdout_);
        else
          composite(in.back, in.exposure, *pixels_, in.camera_from_marker, object_, *plane_,
                    holdout_, image_);
        return;
      }
      default:
        check(false, "the CPU back end has no pass ", name(pass));
    }
  }

  void clear(PassId pass) override {
    if (pass == PassId::shadow) shadow_ = {}, caster_ = {}, plane_.reset();
    if (pass == PassId::shade) object_ = {}, holdout_ = {}, parts_.reset();
  }

  void show(const Picture& back, const Camera& camera) override {
    bare_picture(back, camera, image_);
  }

  std::optional<PartCounts> parts() const override { return parts_; }
  const ShadowMap& shadow_map() override { return shadow_; }
  ObjectLayer object() override { return object_; }
  ObjectLayer holdout() override { return holdout_; }
  void image(Image<std::uint8_t>& out) override { out = image_; }

 private:
  // The layers of what a camera sees. Counts the parts of pixels that it shades.
  void draw(const RenderInput& in, const Camera& camera, ObjectLayer& object,
            ObjectLayer& holdout) {
    const glm::vec3 eye(in.camera_from_marker.inverse().translation);
    // What rays find belongs to one triangle.
    const bool by_rays = traces_rays(in.methods.self_shadow);
    const std::span<FragmentBand> seen =
        rasterizer_.rasterize(in.scene, camera, in.camera_from_marker, in.light_shares,
                              in.holdout_ratios, in.shades_alike_as_one && !by_rays);
    const EntryShares shares{in.self_shares, in.light_shares};
    const bool all = in.methods.self_shadow == SelfShadowMethod::traced;
    if (all && in.lighting.radiance)
      trace_shares(in.scene, in.lighting, eye, shares, in.near_shares, seen);
    // All light by rays does not know where glossy light is; the brightest does.
    const bool brightest = in.methods.self_shadow == SelfShadowMethod::traced_lights ||
                           (all && in.near_shares && in.scene.material.lobe());
    if (brightest && in.lighting.radiance && in.cell_light)
      traced_lights_(in.scene, *in.lighting.radiance, *in.cell_light, in.lighting.irradiance,
                     camera, in.camera_from_marker, shares, in.near_shares, seen, !all);
    // With near lights, lobes are the vertices' own.
    if (in.methods.self_shadow == SelfShadowMethod::pixel_transfer && in.cell_light &&
        !in.near_shares)
      glossy_shares_(in.scene, *in.cell_light, eye, seen);
    if (by_rays && in.shades_alike_as_one) merge_alike(in.scene.material, seen);
    for (const FragmentBand& band : seen)
      parts_->found += band.found, parts_->shaded += double(band.object.size());
    object = shade(seen, in.scene.material, in.lighting, eye);
    holdout = holdout_layer(seen);
  }

  SceneShadow caster_;
  Rasterizer rasterizer_;
  GlossyPixelShares glossy_shares_;
  TracedLights traced_lights_;
  std::optional<PartCounts> parts_;
  ShadowMap shadow_;
  std::optional<ShadowLookUp> plane_;  // the shadow, or what the plane gains in its place
  std::shared_ptr<const ShadowMap> plane_of_;
  ObjectLayer object_, holdout_;
  Image<std::uint8_t> image_;
  std::optional<PixelTable> pixels_;
};

}  // namespace

std::unique_ptr<Renderer> make_cpu_renderer() { return std::make_unique<CpuRenderer>(); }

}  // namespace fastibl
