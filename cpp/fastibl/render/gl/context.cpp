#include "fastibl/render/gl/context.h"

#include <dlfcn.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <cstdlib>
#include <initializer_list>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace fastibl {
namespace {

// libepoxy aborts the process where these are missing, so they are looked for first. They stay
// loaded.
void require_library(const char* file, const char* packages) {
  if (dlopen(file, RTLD_LAZY | RTLD_LOCAL)) return;
  throw std::runtime_error("the GL back end needs " + std::string(file) + " (Debian: apt install " +
                           packages + "); backend=\"cpu\" works without");
}

bool has(const char* extensions, std::string_view wanted) {
  std::istringstream all(extensions ? extensions : "");
  for (std::string one; all >> one;)
    if (one == wanted) return true;
  return false;
}

// A function of the first of these libraries that the program has loaded; null: of none. libepoxy
// would abort the process where they are missing.
template <typename Function>
Function* loaded(std::initializer_list<const char*> libraries, const char* function) {
  for (const char* library : libraries)
    if (void* const found = dlopen(library, RTLD_LAZY | RTLD_NOLOAD)) {
      void* const address = dlsym(found, function);
      dlclose(found);  // it stays, as the program has it loaded
      if (address) return reinterpret_cast<Function*>(address);
    }
  return nullptr;
}

template <typename Function>
Function* glx(const char* function) {
  return loaded<Function>({"libGLX.so.0", "libGL.so.1"}, function);
}
void* glx_context() {
  const auto current = glx<void*()>("glXGetCurrentContext");
  return current ? current() : nullptr;
}
void make_glx_current(const GlxBinding& b) {
  using Make = int(void*, unsigned long, unsigned long, void*);
  glx<Make>("glXMakeContextCurrent")(b.display, b.draw, b.read, b.context);
}

// A thread has a context of GLX or one of EGL, not both. To look for GLX takes 24 us where nothing
// has loaded it, so this is left until EGL has refused.
GlxBinding put_glx_aside() {
  GlxBinding b;
  b.context = glx_context();
  if (!b.context) return b;
  b.display = glx<void*()>("glXGetCurrentDisplay")();
  b.draw = glx<unsigned long()>("glXGetCurrentDrawable")();
  b.read = glx<unsigned long()>("glXGetCurrentReadDrawable")();
  make_glx_current({b.display});
  return b;
}

struct Made {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLSurface surface = EGL_NO_SURFACE;
  EGLContext context = EGL_NO_CONTEXT;
};

// Displays are shared by the whole process, so none is ever terminated.
Made make(EGLDisplay display) {
  Made made;
  if (display == EGL_NO_DISPLAY || !eglInitialize(display, nullptr, nullptr)) return made;
  if (!eglBindAPI(EGL_OPENGL_ES_API)) return made;
  const bool surfaceless =
      has(eglQueryString(display, EGL_EXTENSIONS), "EGL_KHR_surfaceless_context");
  const EGLint wanted[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_ES3_BIT_KHR, EGL_SURFACE_TYPE,
                           surfaceless ? 0 : EGL_PBUFFER_BIT, EGL_NONE};
  EGLConfig config;
  EGLint count = 0;
  if (!eglChooseConfig(display, wanted, &config, 1, &count) || count < 1) return made;
  const EGLint version[] = {EGL_CONTEXT_CLIENT_VERSION, 3, EGL_NONE};
  const EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, version);
  if (context == EGL_NO_CONTEXT) return made;
  if (!surfaceless) {
    const EGLint size[] = {EGL_WIDTH, 1, EGL_HEIGHT, 1, EGL_NONE};
    made.surface = eglCreatePbufferSurface(display, config, size);
    if (made.surface == EGL_NO_SURFACE) {
      eglDestroyContext(display, context);
      return made;
    }
  }
  made.display = display, made.context = context;
  return made;
}

void destroy(const Made& made) {
  if (made.context != EGL_NO_CONTEXT) eglDestroyContext(made.display, made.context);
  if (made.surface != EGL_NO_SURFACE) eglDestroySurface(made.display, made.surface);
}

}  // namespace

const void* current_context() {
  const auto of_egl = loaded<void*()>({"libEGL.so.1"}, "eglGetCurrentContext");
  const void* const context = of_egl ? of_egl() : nullptr;
  return context ? context : glx_context();
}

GlContext::GlContext() {
  const char* library = std::getenv("FASTIBL_EGL_LIBRARY");
  require_library(library ? library : "libEGL.so.1", "libegl1 libgl1-mesa-dri");
  require_library("libGLESv2.so.2", "libgles2 libgl1-mesa-dri");

  const char* client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  const EGLenum api = eglQueryAPI();
  Made best;
  bool software = true;
  const auto consider = [&](EGLDisplay display) {
    const Made made = make(display);
    if (made.context == EGL_NO_CONTEXT) return;
    display_ = made.display, surface_ = made.surface, context_ = made.context;
    std::string renderer;
    {
      const Current current(*this);
      if (const GLubyte* text = glGetString(GL_RENDERER))
        renderer = reinterpret_cast<const char*>(text);
    }
    const bool slow = renderer.find("llvmpipe") != std::string::npos ||
                      renderer.find("softpipe") != std::string::npos ||
                      renderer.find("SwiftShader") != std::string::npos;
    if (best.context == EGL_NO_CONTEXT || (software && !slow)) {
      destroy(best);
      best = made, software = slow;
    } else {
      destroy(made);
    }
  };
  const bool platforms = has(client, "EGL_EXT_platform_base");
  if (platforms && has(client, "EGL_MESA_platform_surfaceless"))
    consider(eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr));
  if (software && platforms && has(client, "EGL_EXT_platform_device") &&
      (has(client, "EGL_EXT_device_base") || has(client, "EGL_EXT_device_enumeration"))) {
    EGLint count = 0;
    eglQueryDevicesEXT(0, nullptr, &count);
    std::vector<EGLDeviceEXT> devices(std::size_t(count > 0 ? count : 0));
    if (!devices.empty()) eglQueryDevicesEXT(count, devices.data(), &count);
    for (const EGLDeviceEXT device : devices) {
      const bool slow =
          has(eglQueryDeviceStringEXT(device, EGL_EXTENSIONS), "EGL_MESA_device_software");
      if (software && !(slow && best.context != EGL_NO_CONTEXT))
        consider(eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, device, nullptr));
    }
  }
  if (best.context == EGL_NO_CONTEXT) consider(eglGetDisplay(EGL_DEFAULT_DISPLAY));
  eglBindAPI(api);
  display_ = best.display, surface_ = best.surface, context_ = best.context;
  if (best.context == EGL_NO_CONTEXT)
    throw std::runtime_error(
        "EGL gives no OpenGL ES 3.0 context, neither surfaceless nor on a device nor on the "
        "default display (Debian: apt install libgl1-mesa-dri); backend=\"cpu\" works without");
}

GlContext::~GlContext() { destroy({display_, surface_, context_}); }

GlContext::Current::Current(const GlContext& context)
    : display_(context.display_),
      previous_display_(eglGetCurrentDisplay()),
      draw_(eglGetCurrentSurface(EGL_DRAW)),
      read_(eglGetCurrentSurface(EGL_READ)),
      previous_(eglGetCurrentContext()),
      api_(eglQueryAPI()) {
  const auto made = [&] {
    return eglMakeCurrent(context.display_, context.surface_, context.surface_, context.context_);
  };
  eglBindAPI(EGL_OPENGL_ES_API);
  if (made()) return;
  glx_ = put_glx_aside();
  if (glx_.context && made()) return;
  eglBindAPI(api_);
  if (glx_.context) make_glx_current(glx_);
  throw std::runtime_error("the GL context is in use by another thread");
}

GlContext::Current::~Current() {
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglBindAPI(api_);
  if (previous_ != EGL_NO_CONTEXT) eglMakeCurrent(previous_display_, draw_, read_, previous_);
  if (glx_.context) make_glx_current(glx_);
}

}  // namespace fastibl
