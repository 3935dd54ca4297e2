// The composite pass, and its image. Private to render/gl.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "fastibl/core/image.h"
#include "fastibl/render/gl/camera_textures.h"
#include "fastibl/render/gl/gl_renderer.h"
#include "fastibl/render/gl/gpu.h"
#include "fastibl/render/gl/outline.h"
#include "fastibl/render/gl/shade_pass.h"
#include "fastibl/render/gl/shadow_pass.h"
#include "fastibl/render/renderer.h"

namespace fastibl {

class CompositePass {
 public:
  void run(Gpu& gpu, const ShadowPass& shadow, const ShadePass& shade, const RenderInput& in);

  // The texture's picture, width × height pixels, is the image and what run() draws over, until
  // another one comes, or none.
  void take(Gpu& gpu, const CameraTexture& texture, int width, int height);
  void take_none() { taken_ = false, bytes_ = {}, area_ = {}; }

  void show(const Picture& back, const Camera& camera);  // without a scope
  void image(Gpu& gpu, Image<std::uint8_t>& out);        // reads back; outside a scope
  void present(Gpu& gpu, GLuint framebuffer, int width, int height);

 private:
  void upload_gain(Gpu& gpu, const std::shared_ptr<const ShadowMap>& gain);
  void fill_screen(Gpu& gpu);  // puts the whole image into `screen_`

  CameraTextures camera_;
  Texture back_, linear_back_, taken_back_, picture_, screen_;
  bool taken_ = false;  // the back picture is in `taken_back_`
  Texture gain_, outer_gain_, fine_gain_;
  std::shared_ptr<const ShadowMap> gain_map_;  // which they hold
  Area area_;                                  // the drawn part
  Image<std::uint8_t> bytes_;                  // the image outside `area_`
  GLuint read_back_ = 0;                       // a buffer of this many bytes
  std::size_t read_back_size_ = 0;
};

}  // namespace fastibl
