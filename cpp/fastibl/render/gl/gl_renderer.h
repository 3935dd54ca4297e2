// The OpenGL ES 3.0 back end. It mirrors the CPU one, pass by pass.
#pragma once

#include <memory>

#include "fastibl/render/renderer.h"

namespace fastibl {

class GlRenderer : public Renderer {
 public:
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
