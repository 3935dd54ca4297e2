// A headless OpenGL ES 3.0 context of its own, made with EGL.
#pragma once

namespace fastibl {

// The context that is current in this thread, EGL's or GLX's; null: there is none.
const void* current_context();

// What GLX has current in a thread.
struct GlxBinding {
  void* display = nullptr;
  unsigned long draw = 0, read = 0;
  void* context = nullptr;
};

// Needs no display: tries Mesa's surfaceless platform, then devices, then the default display, and
// prefers hardware. Throws std::runtime_error that names what is missing. The environment variable
// FASTIBL_EGL_LIBRARY names a file to look for instead of libEGL.so.1 (for tests).
class GlContext {
 public:
  GlContext();
  ~GlContext();
  GlContext(const GlContext&) = delete;
  GlContext& operator=(const GlContext&) = delete;

  // Makes the context current in the calling thread while this lives; then restores the previous
  // one, of EGL or GLX.
  class Current {
   public:
    explicit Current(const GlContext& context);
    ~Current();
    Current(const Current&) = delete;
    Current& operator=(const Current&) = delete;

   private:
    void *display_, *previous_display_, *draw_, *read_, *previous_;
    unsigned api_;
    GlxBinding glx_;
  };

 private:
  void *display_ = nullptr, *surface_ = nullptr, *context_ = nullptr;
};

}  // namespace fastibl
