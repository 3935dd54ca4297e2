// The OpenGL ES 3.0 back end. It mirrors the CPU one, pass by pass.
#pragma once

#include <memory>

#include "fastibl/core/vector.h"
#include "fastibl/render/renderer.h"

namespace fastibl {

// A camera's picture in a texture of the caller's: codes, as those of an 8-bit picture. (What the
// GPU decodes, as the format is sRGB, is encoded again.)
struct CameraTexture {
  unsigned name = 0;
  unsigned target = 0x0DE1;  // GL_TEXTURE_2D, or GL_TEXTURE_EXTERNAL_OES (0x8D65)
  // Texture coordinates (s, t, 1) of a place (u, v, 1) in the picture: u goes from 0 at its left to
  // 1 at its right, v from 0 at its top to 1 at its bottom. As it is here, the texture's first row
  // is the top one.
  glm::mat3 uv_from_picture{1};
};

class GlRenderer : public Renderer {
 public:
  // From now on, the texture's picture is the image, and composite draws over it, not over
  // RenderInput::back. The texture is read before this returns, filtered where its size is another
  // one; it is not changed, and its own filters and edges do not count. To be called for each new
  // picture, by a renderer that was made with CurrentContext.
  // camera: whose picture it is, of the size of the image. A Session's back camera may be another
  // one, neither moved nor turned against it.
  // Throws std::invalid_argument for what is no such texture, and std::runtime_error for an
  // external one where the driver has no GL_OES_EGL_image_external_essl3, as in desktop GL. The
  // picture is then the one before.
  virtual void set_back_texture(const CameraTexture& texture, const Camera& camera) = 0;
  virtual void clear_back_texture() = 0;  // RenderInput::back counts again

  // Draws the image, scaled to width × height pixels, into a framebuffer of the caller's context
  // (0: the window), with row 0 at the top and without reading it back. The framebuffer may be
  // multisampled; one that is encoded as sRGB gets the same codes. For a renderer that was made
  // with CurrentContext.
  virtual void present(unsigned framebuffer, int width, int height) = 0;

  // Says that the context is gone: nothing in it is deleted at the end, and other calls throw.
  virtual void abandon() = 0;
};

// Makes a renderer with a headless context of its own; any thread may call it, one at a time.
// Throws std::runtime_error where there is no EGL, no driver, or no float targets
// (EXT_color_buffer_float).
// FASTIBL_GL_HALF=1 in the environment stores the map in half floats even where the driver can
// filter floats; FASTIBL_GL_BAKED=1 reads every diffuse method from a cube map, as is always done
// for methods without a shader of their own.
std::unique_ptr<GlRenderer> make_gl_renderer();

// Draws in the context that is current now: OpenGL ES 3.0, or desktop GL 4.3. All state is
// restored. It must also be current at every later call, which throws std::runtime_error otherwise,
// and at the end: elsewhere nothing is deleted.
struct CurrentContext {};
std::unique_ptr<GlRenderer> make_gl_renderer(CurrentContext);

}  // namespace fastibl
