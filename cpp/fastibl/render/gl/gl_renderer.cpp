#include "fastibl/render/gl/gl_renderer.h"

#include <epoxy/gl.h>

#include <optional>
#include <stdexcept>

#include "fastibl/core/check.h"
#include "fastibl/render/gl/composite_pass.h"
#include "fastibl/render/gl/gpu.h"
#include "fastibl/render/gl/light_textures.h"
#include "fastibl/render/gl/shade_pass.h"
#include "fastibl/render/gl/shadow_pass.h"

namespace fastibl {
namespace {

class Gl final : public GlRenderer {
 public:
  explicit Gl(bool own_context) : gpu_(own_context) {}

  std::string_view backend() const override { return "gl"; }
  bool has(SelfShadowMethod method) const override {
    return !shares_by_pixel(method) || PixelShares::has(method);
  }
  std::string device() const override { return gpu_.device(); }

  void run(PassId pass, const RenderInput& in) override {
    const Gpu::Scope scope(gpu_);
    switch (pass) {
      case PassId::shadow:
        shadow_.run(gpu_, light_, in);
        break;
      case PassId::shade:
        shade_.run(gpu_, light_, in);
        break;
      case PassId::composite:
        check(!texture_camera_ || *in.camera == *texture_camera_,
              "over a texture's picture, only its own camera draws");
        composite_.run(gpu_, shadow_, shade_, in);
        break;
      default:
        check(false, "the GL back end has no pass ", name(pass));
    }
    if (!gpu_.own_context()) return;
    // This makes timings cover the work. Nothing is lost: the image is read back anyway.
    glFinish();
    const GLenum error = glGetError();
    if (error != GL_NO_ERROR)
      throw std::runtime_error("GL error " + std::to_string(error) + " in the pass " +
                               std::string(name(pass)));
  }

  void clear(PassId pass) override {
    if (pass == PassId::shadow) shadow_.clear();
    if (pass == PassId::shade) shade_.clear();
  }

  void show(const Picture& back, const Camera& camera) override { composite_.show(back, camera); }
  const Camera* texture_camera() const override {
    return texture_camera_ ? &*texture_camera_ : nullptr;
  }

  void set_back_texture(const CameraTexture& texture, const Camera& camera) override {
    check(!gpu_.own_context(), "only a renderer in the caller's context can read its textures");
    camera.validate();
    const Gpu::Scope scope(gpu_);
    composite_.take(gpu_, texture, camera.width, camera.height);
    texture_camera_ = camera;
  }
  void clear_back_texture() override {
    composite_.take_none();
    texture_camera_.reset();
  }

  const ShadowMap& shadow_map() override { return shadow_.shadow_map(gpu_); }
  ObjectLayer object() override { return shade_.layer(gpu_); }
  ObjectLayer holdout() override { return shade_.holdout_layer(gpu_); }
  void image(Image<std::uint8_t>& out) override { composite_.image(gpu_, out); }

  void present(unsigned framebuffer, int width, int height) override {
    check(!gpu_.own_context(), "only a renderer in the caller's context can present its picture");
    const Gpu::Scope scope(gpu_);
    composite_.present(gpu_, framebuffer, width, height);
  }

  void abandon() override { gpu_.abandon(); }

 private:
  Gpu gpu_;
  LightTextures light_;  // shared by two passes
  ShadowPass shadow_;
  ShadePass shade_;
  CompositePass composite_;
  std::optional<Camera> texture_camera_;
};

}  // namespace

std::unique_ptr<GlRenderer> make_gl_renderer() { return std::make_unique<Gl>(true); }
std::unique_ptr<GlRenderer> make_gl_renderer(CurrentContext) { return std::make_unique<Gl>(false); }

}  // namespace fastibl
