// The GL back end in a context of the caller: it draws the same picture, leaves no state behind,
// and gives a window its picture without read-back.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <dlfcn.h>
#include <doctest/doctest.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/render/gl/context.h"
#include "fastibl/render/gl/gl_renderer.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/render/session.h"

using namespace fastibl;

namespace {

constexpr int kWidth = 160, kHeight = 120;

struct Inputs {
  Scene scene;
  Methods methods;
  Lighting lighting;
  Camera camera;
  Pose camera_from_marker;
  std::vector<std::uint8_t> pixels;
  Picture back;

  RenderInput input() const {
    return {scene, methods, lighting, &camera, camera_from_marker, back, 1.0};
  }
};

// A tetrahedron on the marker under a sky with one coloured face per side, seen from above.
Inputs inputs() {
  Inputs in;
  Mesh mesh;
  mesh.vertices = {
      {-0.05f, -0.03f, 0.01f}, {0.05f, -0.03f, 0.01f}, {0, 0.06f, 0.01f}, {0, 0, 0.08f}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  Material material;
  material.glossy = glm::vec3(0.3f);
  in.scene = make_scene(mesh, material, {}, {10, 0});
  std::vector<glm::vec3> faces(6 * 8 * 8);
  for (std::size_t i = 0; i < faces.size(); ++i)
    faces[i] = glm::vec3(0.2f + 0.1f * float(i / 64), 0.5f, 0.8f - 0.1f * float(i / 64));
  in.lighting = fit_lighting(std::make_shared<const CubeMap>(8, faces));
  in.camera.width = kWidth, in.camera.height = kHeight;
  in.camera.fx = in.camera.fy = 150, in.camera.cx = 80, in.camera.cy = 60;
  in.camera_from_marker.rotation = glm::dmat3(1, 0, 0, 0, -1, 0, 0, 0, -1);
  in.camera_from_marker.translation = {0.01, 0.02, 0.4};
  for (int i = 0; i < kWidth * kHeight * 3; ++i) in.pixels.push_back(std::uint8_t(i * 37 % 256));
  in.back = {in.pixels.data(), PixelType::uint8, kWidth, kHeight, kWidth * 3};
  return in;
}

void draw(Renderer& renderer, const Inputs& in) {
  for (const PassId pass : kRenderPasses) renderer.run(pass, in.input());
}

bool have_egl() {
  if (dlopen("libEGL.so.1", RTLD_LAZY)) return true;
  std::puts("skipped: no libEGL.so.1");
  return false;
}

// Every integer state that a renderer could touch.
std::vector<GLint> state() {
  std::vector<GLint> all;
  const auto add = [&](GLenum name, int count = 1) {
    GLint values[4] = {};
    glGetIntegerv(name, values);
    all.insert(all.end(), values, values + count);
  };
  GLint active = 0;
  glGetIntegerv(GL_ACTIVE_TEXTURE, &active);
  for (int unit = 0; unit < 16; ++unit) {
    glActiveTexture(GLenum(GL_TEXTURE0 + unit));
    for (const GLenum name :
         {GL_TEXTURE_BINDING_2D, GL_TEXTURE_BINDING_CUBE_MAP, GL_TEXTURE_BINDING_2D_ARRAY,
          GL_TEXTURE_BINDING_3D, GL_SAMPLER_BINDING})
      add(name);
  }
  if (epoxy_has_gl_extension("GL_OES_EGL_image_external"))
    for (int unit = 0; unit < 16; ++unit)
      glActiveTexture(GLenum(GL_TEXTURE0 + unit)), add(GL_TEXTURE_BINDING_EXTERNAL_OES);
  glActiveTexture(GLenum(active));
  for (const GLenum name : {GL_VIEWPORT, GL_SCISSOR_BOX, GL_COLOR_WRITEMASK}) add(name, 4);
  for (const GLenum name : {GL_ACTIVE_TEXTURE,
                            GL_CURRENT_PROGRAM,
                            GL_VERTEX_ARRAY_BINDING,
                            GL_ARRAY_BUFFER_BINDING,
                            GL_ELEMENT_ARRAY_BUFFER_BINDING,
                            GL_UNIFORM_BUFFER_BINDING,
                            GL_DRAW_FRAMEBUFFER_BINDING,
                            GL_READ_FRAMEBUFFER_BINDING,
                            GL_RENDERBUFFER_BINDING,
                            GL_PIXEL_PACK_BUFFER_BINDING,
                            GL_PIXEL_UNPACK_BUFFER_BINDING,
                            GL_DEPTH_FUNC,
                            GL_DEPTH_WRITEMASK,
                            GL_SCISSOR_TEST,
                            GL_DEPTH_TEST,
                            GL_BLEND,
                            GL_CULL_FACE,
                            GL_STENCIL_TEST,
                            GL_DITHER,
                            GL_POLYGON_OFFSET_FILL,
                            GL_RASTERIZER_DISCARD,
                            GL_SAMPLE_ALPHA_TO_COVERAGE,
                            GL_SAMPLE_COVERAGE,
                            GL_UNPACK_ALIGNMENT,
                            GL_UNPACK_ROW_LENGTH,
                            GL_UNPACK_SKIP_ROWS,
                            GL_UNPACK_SKIP_PIXELS,
                            GL_UNPACK_IMAGE_HEIGHT,
                            GL_UNPACK_SKIP_IMAGES,
                            GL_PACK_ALIGNMENT,
                            GL_PACK_ROW_LENGTH,
                            GL_PACK_SKIP_ROWS,
                            GL_PACK_SKIP_PIXELS,
                            GL_CULL_FACE_MODE,
                            GL_FRONT_FACE,
                            GL_BLEND_SRC_RGB,
                            GL_STENCIL_FUNC})
    add(name);
  GLfloat range[2], clear[4];
  glGetFloatv(GL_DEPTH_RANGE, range), glGetFloatv(GL_COLOR_CLEAR_VALUE, clear);
  for (const GLfloat value : {range[0], range[1], clear[0], clear[1], clear[2], clear[3]})
    all.push_back(GLint(1000 * value));
  return all;
}

// Sets states that differ from those the renderer works with.
struct Untidy {
  GLuint textures[3], buffers[3], array, framebuffer, renderbuffer, sampler;
  Untidy() {
    glGenTextures(3, textures), glGenBuffers(3, buffers), glGenVertexArrays(1, &array);
    glGenFramebuffers(1, &framebuffer), glGenRenderbuffers(1, &renderbuffer);
    glGenSamplers(1, &sampler);
    for (int unit = 0; unit < 8; ++unit) {
      glActiveTexture(GLenum(GL_TEXTURE0 + unit));
      glBindTexture(GL_TEXTURE_2D, textures[0]), glBindTexture(GL_TEXTURE_CUBE_MAP, textures[1]);
      glBindTexture(GL_TEXTURE_2D_ARRAY, textures[2]);
      glBindSampler(GLuint(unit), sampler);
    }
    glActiveTexture(GL_TEXTURE3);
    glBindVertexArray(array);
    glBindBuffer(GL_ARRAY_BUFFER, buffers[0]);
    for (int i = 1; i < 3; ++i) {
      const GLenum kind = i == 1 ? GL_PIXEL_PACK_BUFFER : GL_PIXEL_UNPACK_BUFFER;
      glBindBuffer(kind, buffers[i]);
      glBufferData(kind, 4, nullptr, GL_STREAM_DRAW);
    }
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glBindRenderbuffer(GL_RENDERBUFFER, renderbuffer);
    for (const GLenum name :
         {GL_SCISSOR_TEST, GL_DEPTH_TEST, GL_BLEND, GL_CULL_FACE, GL_STENCIL_TEST, GL_DITHER,
          GL_POLYGON_OFFSET_FILL, GL_RASTERIZER_DISCARD, GL_SAMPLE_COVERAGE})
      glEnable(name);
    glScissor(1, 2, 3, 4), glViewport(5, 6, 7, 8);
    glColorMask(GL_FALSE, GL_TRUE, GL_FALSE, GL_TRUE);
    glDepthMask(GL_FALSE), glDepthFunc(GL_ALWAYS), glDepthRangef(0.25f, 0.75f);
    glFrontFace(GL_CW), glCullFace(GL_FRONT), glClearColor(0.1f, 0.2f, 0.3f, 0.4f);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 8), glPixelStorei(GL_UNPACK_ROW_LENGTH, 11);
    glPixelStorei(GL_UNPACK_SKIP_ROWS, 2), glPixelStorei(GL_UNPACK_SKIP_PIXELS, 3);
    glPixelStorei(GL_PACK_ALIGNMENT, 2), glPixelStorei(GL_PACK_ROW_LENGTH, 500);
    glPixelStorei(GL_PACK_SKIP_PIXELS, 1), glPixelStorei(GL_PACK_SKIP_ROWS, 1);
  }
};

int apart(const Image<std::uint8_t>& a, const Image<std::uint8_t>& b) {
  REQUIRE(a.data.size() == b.data.size());
  int worst = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i)
    worst = std::max(worst, std::abs(int(a.data[i]) - int(b.data[i])));
  return worst;
}

}  // namespace

namespace {

// A framebuffer of the caller's that a picture is presented to.
struct Window {
  GLuint framebuffer = 0;
  Window() {
    GLuint texture = 0;
    glGenTextures(1, &texture), glBindTexture(GL_TEXTURE_2D, texture);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, kWidth, kHeight, 0, GL_RGBA, GL_UNSIGNED_BYTE,
                 nullptr);
    glGenFramebuffers(1, &framebuffer);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, texture, 0);
  }
  // What it shows, with the image's channels, row 0 on top.
  Image<std::uint8_t> shown(int channels = 3) const {
    Image<std::uint8_t> read(kWidth, kHeight, 4), out(kWidth, kHeight, channels);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glReadPixels(0, 0, kWidth, kHeight, GL_RGBA, GL_UNSIGNED_BYTE, read.data.data());
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        std::copy_n(read.pixel(x, kHeight - 1 - y), channels, out.pixel(x, y));
    return out;
  }
};

}  // namespace

TEST_CASE("a context of its own: the CPU's picture, and nothing current afterwards") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const auto cpu = make_cpu_renderer();
  const auto gl = make_gl_renderer();
  std::printf("%s\n", gl->device().c_str());
  CHECK(gl->backend() == "gl");
  draw(*cpu, in), draw(*gl, in);
  CHECK(apart(cpu->image(), gl->image()) <= 2);
  CHECK(eglGetCurrentContext() == EGL_NO_CONTEXT);
  CHECK_THROWS_AS(gl->run(PassId::track, in.input()), std::invalid_argument);
  CHECK(eglGetCurrentContext() == EGL_NO_CONTEXT);
  gl->clear(PassId::shadow), gl->clear(PassId::shade);
  gl->run(PassId::composite, in.input());
  CHECK(gl->image().data == in.pixels);
}

TEST_CASE("the caller's context: same picture, its state put back") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  const EGLContext handle = eglGetCurrentContext();
  const auto other = make_gl_renderer();
  draw(*other, in);
  CHECK(eglGetCurrentContext() == handle);

  const Untidy untidy;
  REQUIRE(glGetError() == GL_NO_ERROR);
  const std::vector<GLint> before = state();
  {
    const auto gl = make_gl_renderer(CurrentContext{});
    CHECK(state() == before);
    for (const PassId pass : kRenderPasses) {
      gl->run(pass, in.input());
      CHECK(state() == before);
    }
    CHECK(gl->image() == other->image());
    CHECK(gl->object() == other->object());
    CHECK(gl->shadow_map() == other->shadow_map());
    CHECK(state() == before);
  }
  CHECK(state() == before);
  CHECK(glGetError() == GL_NO_ERROR);
}

TEST_CASE("present draws the whole picture, row 0 on top") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  const auto gl = make_gl_renderer(CurrentContext{});
  const Window window;
  gl->present(window.framebuffer, kWidth, kHeight);  // there is nothing yet
  for (int frame = 0; frame < 2; ++frame) {
    draw(*gl, in);
    glEnable(GL_SCISSOR_TEST);
    glScissor(0, 0, 1, 1);
    gl->present(window.framebuffer, kWidth, kHeight);
    glDisable(GL_SCISSOR_TEST);
    CHECK(window.shown() == gl->image());
  }
  CHECK(glGetError() == GL_NO_ERROR);
}

namespace {

// A session that draws the inputs' object by `gl`, for a frame with their picture and pose.
Session session_of(const Inputs& in, std::unique_ptr<Renderer> gl, SessionOptions options = {}) {
  Rig rig;
  rig.back = in.camera;
  const Environment light = environment_from(*in.lighting.radiance);
  return {in.scene, rig,           std::nullopt, std::make_shared<const Environment>(light),
          nullptr,  std::move(gl), options};
}
Frame frame_of(const Inputs& in) {
  Frame frame;
  frame.back = in.back, frame.back_from_marker = in.camera_from_marker;
  return frame;
}

}  // namespace

TEST_CASE("present shows a session's frames, also without a pose and without read-back") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  const Window window;
  for (const bool read_back : {true, false}) {
    CAPTURE(read_back);
    auto made = make_gl_renderer(CurrentContext{});
    GlRenderer& gl = *made;
    SessionOptions options;
    options.read_back = read_back;
    Session session = session_of(in, std::move(made), options);
    Session reads = session_of(in, make_gl_renderer(CurrentContext{}));
    Frame frame = frame_of(in), lost = frame, bare = frame;
    lost.back_from_marker.reset(), bare.back = {};
    FrameResult result;
    for (const Frame& one : {frame, lost, bare, frame}) {
      session.process(one, result);
      gl.present(window.framebuffer, kWidth, kHeight);
      const Image<std::uint8_t> image = reads.process(one).image;
      CHECK(window.shown(image.channels) == image);
      CHECK(result.image.width == (read_back ? kWidth : 0));
      CHECK(gl.image() == image);
    }
  }
  CHECK(glGetError() == GL_NO_ERROR);
}

namespace {

// A context of desktop GL 4.5, as an engine has; false if the driver has none.
struct DesktopContext {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
  explicit DesktopContext(EGLint profile = EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT) {
    display = eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
    if (display == EGL_NO_DISPLAY || !eglInitialize(display, nullptr, nullptr)) return;
    eglBindAPI(EGL_OPENGL_API);
    const EGLint version[] = {EGL_CONTEXT_MAJOR_VERSION,
                              4,
                              EGL_CONTEXT_MINOR_VERSION,
                              5,
                              EGL_CONTEXT_OPENGL_PROFILE_MASK,
                              profile,
                              EGL_NONE};
    context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, version);
    if (context == EGL_NO_CONTEXT) return;
    eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context);
  }
  ~DesktopContext() {
    if (context != EGL_NO_CONTEXT) {
      eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
      eglDestroyContext(display, context);
    }
    eglBindAPI(EGL_OPENGL_ES_API);
  }
};

// State that only desktop GL has.
std::vector<GLfloat> desktop_state() {
  std::vector<GLfloat> all;
  for (GLuint i = 0; i < 3; ++i) {
    GLboolean mask[4];
    GLfloat viewport[4];
    GLint scissor[4];
    glGetBooleani_v(GL_COLOR_WRITEMASK, i, mask), glGetFloati_v(GL_VIEWPORT, i, viewport);
    glGetIntegeri_v(GL_SCISSOR_BOX, i, scissor);
    for (int k = 0; k < 4; ++k)
      all.insert(all.end(), {GLfloat(mask[k]), viewport[k], GLfloat(scissor[k])});
    all.push_back(glIsEnabledi(GL_BLEND, i)), all.push_back(glIsEnabledi(GL_SCISSOR_TEST, i));
    GLfloat range[2];
    glGetFloati_v(GL_DEPTH_RANGE, i, range);
    all.insert(all.end(), range, range + 2);
  }
  for (const GLenum name :
       {GL_CLIP_ORIGIN, GL_CLIP_DEPTH_MODE, GL_COLOR_LOGIC_OP, GL_FRAMEBUFFER_SRGB, GL_DEPTH_CLAMP,
        GL_TEXTURE_CUBE_MAP_SEAMLESS, GL_POLYGON_MODE, GL_UNPACK_SWAP_BYTES, GL_PACK_SWAP_BYTES,
        GL_CLAMP_READ_COLOR, GL_CLIP_DISTANCE0, GL_POLYGON_SMOOTH}) {
    GLint values[2] = {};
    glGetIntegerv(name, values);
    all.push_back(GLfloat(values[0]));
  }
  return all;
}

}  // namespace

TEST_CASE("an engine's desktop context: same picture, its state put back") {
  if (!have_egl()) return;
  const DesktopContext desktop;
  if (desktop.context == EGL_NO_CONTEXT) {
    std::puts("skipped: no desktop GL 4.5");
    return;
  }
  const Inputs in = inputs();
  const auto plain = make_gl_renderer(CurrentContext{});
  draw(*plain, in);
  const auto polygons = [] { glPolygonMode(GL_FRONT_AND_BACK, GL_LINE); };
  const auto reversed = [] { glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE); };
  const auto upside_down = [] { glClipControl(GL_UPPER_LEFT, GL_ZERO_TO_ONE); };
  const auto logic = [] { glEnable(GL_COLOR_LOGIC_OP), glLogicOp(GL_INVERT); };
  const auto encoded = [] { glEnable(GL_FRAMEBUFFER_SRGB), glEnable(GL_DEPTH_CLAMP); };
  const auto indexed = [] {
    glColorMaski(1, GL_FALSE, GL_TRUE, GL_FALSE, GL_TRUE), glEnablei(GL_BLEND, 2);
    glViewportIndexedf(1, 1, 2, 30, 40), glScissorIndexed(2, 5, 6, 7, 8);
  };
  const auto places = [] { glDepthRangeIndexed(1, 0.25, 0.5), glEnablei(GL_SCISSOR_TEST, 2); };
  const auto bytes = [] {
    glPixelStorei(GL_UNPACK_SWAP_BYTES, GL_TRUE), glPixelStorei(GL_PACK_SWAP_BYTES, GL_TRUE);
  };
  const auto clamped = [] { glClampColor(GL_CLAMP_READ_COLOR, GL_TRUE); };
  const auto clipped = [] { glEnable(GL_CLIP_DISTANCE0), glEnable(GL_POLYGON_SMOOTH); };
  const std::vector<void (*)()> untidy{polygons, reversed, upside_down, logic,   encoded,
                                       indexed,  places,   bytes,       clamped, clipped};
  for (std::size_t k = 0; k < untidy.size(); ++k) {
    CAPTURE(k);
    untidy[k]();
    const std::vector<GLfloat> before = desktop_state();
    const auto gl = make_gl_renderer(CurrentContext{});
    draw(*gl, in);
    CHECK(desktop_state() == before);
    CHECK(apart(gl->image(), plain->image()) == 0);
    CHECK(gl->object() == plain->object());
    CHECK(desktop_state() == before);
  }
  CHECK(glGetError() == GL_NO_ERROR);
}

TEST_CASE("a desktop context of the compatibility profile: its alpha test is left out") {
  if (!have_egl()) return;
  const DesktopContext desktop(EGL_CONTEXT_OPENGL_COMPATIBILITY_PROFILE_BIT);
  if (desktop.context == EGL_NO_CONTEXT) {
    std::puts("skipped: no compatibility profile");
    return;
  }
  const Inputs in = inputs();
  const auto plain = make_gl_renderer(CurrentContext{}), gl = make_gl_renderer(CurrentContext{});
  draw(*plain, in);
  glEnable(GL_ALPHA_TEST), glAlphaFunc(GL_NEVER, 0);
  draw(*gl, in);
  CHECK(glIsEnabled(GL_ALPHA_TEST));
  CHECK(apart(gl->image(), plain->image()) == 0);
  CHECK(glGetError() == GL_NO_ERROR);
}

namespace {

// A state that an extension of OpenGL ES adds, which an engine may set.
struct Added {
  const char* extension;
  void (*set)();
  std::vector<GLint> (*get)();
};

std::vector<GLint> values_of(std::initializer_list<GLenum> names) {
  std::vector<GLint> all;
  for (const GLenum name : names) {
    GLint values[4] = {};
    glGetIntegerv(name, values);
    all.push_back(values[0]);
  }
  return all;
}

std::vector<GLint> of_buffers() {
  std::vector<GLint> all;
  for (GLuint i = 0; i < 4; ++i) {
    GLint mask[4];
    glGetIntegeri_v(GL_COLOR_WRITEMASK, i, mask);
    all.insert(all.end(), mask, mask + 4);
    all.push_back(glIsEnabledi(GL_BLEND, i));
  }
  return all;
}

std::vector<GLint> of_viewports() {
  std::vector<GLint> all;
  for (GLuint i = 0; i < 4; ++i) {
    GLfloat place[4], range[2];
    glGetFloati_v(GL_VIEWPORT, i, place), glGetFloati_v(GL_DEPTH_RANGE, i, range);
    for (const GLfloat value : place) all.push_back(GLint(value));
    all.push_back(GLint(100 * range[0])), all.push_back(glIsEnabledi(GL_SCISSOR_TEST, i));
  }
  return all;
}

// Of an engine, not linked yet: puts all vertices in the middle.
GLuint point_program() {
  const GLuint program = glCreateProgram();
  for (const auto& [kind, text] :
       {std::pair{GL_VERTEX_SHADER,
                  "#version 300 es\nvoid main() { gl_Position = vec4(0, 0, 0, 1); }"},
        std::pair{GL_FRAGMENT_SHADER, "#version 300 es\nvoid main() {}"}}) {
    const GLuint shader = glCreateShader(GLenum(kind));
    glShaderSource(shader, 1, &text, nullptr), glCompileShader(shader);
    glAttachShader(program, shader);
  }
  return program;
}

}  // namespace

TEST_CASE("an engine's state of ES extensions: same picture, its state put back") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  const auto plain = make_gl_renderer(CurrentContext{});
  draw(*plain, in);
  const Image<std::uint8_t> image = plain->image();
  const auto clip_control = [] { return values_of({GL_CLIP_ORIGIN, GL_CLIP_DEPTH_MODE}); };
  const Added added[] = {
      {"GL_EXT_clip_control", [] { glClipControlEXT(GL_LOWER_LEFT, GL_ZERO_TO_ONE); },
       clip_control},
      {"GL_EXT_clip_control", [] { glClipControlEXT(GL_UPPER_LEFT, GL_ZERO_TO_ONE); },
       clip_control},
      {"GL_NV_polygon_mode", [] { glPolygonModeNV(GL_FRONT_AND_BACK, GL_LINE); },
       [] { return values_of({GL_POLYGON_MODE}); }},
      {"GL_EXT_clip_cull_distance", [] { glEnable(GL_CLIP_DISTANCE1); },
       [] { return std::vector<GLint>{glIsEnabled(GL_CLIP_DISTANCE1)}; }},
      {"GL_ANGLE_pack_reverse_row_order",
       [] { glPixelStorei(GL_PACK_REVERSE_ROW_ORDER_ANGLE, GL_TRUE); },
       [] { return values_of({GL_PACK_REVERSE_ROW_ORDER_ANGLE}); }},
      {"GL_EXT_draw_buffers_indexed",
       [] { glColorMaski(1, GL_FALSE, GL_TRUE, GL_FALSE, GL_TRUE), glEnablei(GL_BLEND, 2); },
       of_buffers},
      {"GL_OES_viewport_array",
       [] {
         glViewportIndexedf(1, 1, 2, 30, 40), glDepthRangeIndexedfOES(2, 0.25f, 0.5f);
         glEnablei(GL_SCISSOR_TEST, 3);
       },
       of_viewports}};
  for (const Added& one : added) {
    CAPTURE(std::string(one.extension));
    if (!epoxy_has_gl_extension(one.extension)) {
      std::printf("skipped: no %s\n", one.extension);
      continue;
    }
    const std::vector<GLint> tidy = one.get();
    one.set();
    const std::vector<GLint> before = one.get();
    CHECK(before != tidy);
    const auto gl = make_gl_renderer(CurrentContext{});
    draw(*gl, in);
    CHECK(one.get() == before);
    CHECK(apart(gl->image(), image) == 0);
    CHECK(one.get() == before);
    CHECK(glGetError() == GL_NO_ERROR);
  }
}

TEST_CASE("while the caller captures vertices: same picture, and it goes on capturing") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  const auto plain = make_gl_renderer(CurrentContext{}), gl = make_gl_renderer(CurrentContext{});
  draw(*plain, in);
  const GLuint program = point_program();
  const char* captured = "gl_Position";
  glTransformFeedbackVaryings(program, 1, &captured, GL_INTERLEAVED_ATTRIBS);
  glLinkProgram(program), glUseProgram(program);
  GLuint buffer = 0, query = 0, framebuffer = 0, renderbuffer = 0;
  glGenBuffers(1, &buffer), glGenQueries(1, &query);
  glGenFramebuffers(1, &framebuffer), glGenRenderbuffers(1, &renderbuffer);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glBindRenderbuffer(GL_RENDERBUFFER, renderbuffer);
  glRenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, 1, 1);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, renderbuffer);
  glBindBufferBase(GL_TRANSFORM_FEEDBACK_BUFFER, 0, buffer);
  glBufferData(GL_TRANSFORM_FEEDBACK_BUFFER, 1024, nullptr, GL_STREAM_READ);
  glBeginQuery(GL_TRANSFORM_FEEDBACK_PRIMITIVES_WRITTEN, query);
  glBeginTransformFeedback(GL_TRIANGLES);
  draw(*gl, in);
  CHECK(apart(gl->image(), plain->image()) == 0);
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glEndTransformFeedback();
  glEndQuery(GL_TRANSFORM_FEEDBACK_PRIMITIVES_WRITTEN);
  GLuint written = 0;
  glGetQueryObjectuiv(query, GL_QUERY_RESULT, &written);
  CHECK(written == 1);
  CHECK(glGetError() == GL_NO_ERROR);
}

TEST_CASE("a program that is in use and marked for deletion: gone, and none is in its place") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  const auto gl = make_gl_renderer(CurrentContext{});
  const GLuint program = point_program();
  glLinkProgram(program), glUseProgram(program), glDeleteProgram(program);
  draw(*gl, in);
  GLint used = -1;
  glGetIntegerv(GL_CURRENT_PROGRAM, &used);
  CHECK(used == 0);
  CHECK(glGetError() == GL_NO_ERROR);
}

TEST_CASE("another context, or none: refused, and nothing of the other is deleted") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  CHECK_THROWS_AS(make_gl_renderer(CurrentContext{}), std::runtime_error);
  const GlContext first, second;
  std::unique_ptr<GlRenderer> gl;
  {
    const GlContext::Current current(first);
    gl = make_gl_renderer(CurrentContext{});
    draw(*gl, in);
  }
  CHECK_THROWS_AS(draw(*gl, in), std::runtime_error);
  const GlContext::Current current(second);
  CHECK_THROWS_AS(draw(*gl, in), std::runtime_error);
  CHECK_THROWS_AS(gl->image(), std::runtime_error);
  const auto other = make_gl_renderer(CurrentContext{});
  draw(*other, in);
  gl.reset();
  draw(*other, in);
  CHECK(other->object().rgba.width > 0);
  CHECK(glGetError() == GL_NO_ERROR);
}

TEST_CASE("an abandoned renderer touches its context no more") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  auto gl = make_gl_renderer(CurrentContext{});
  draw(*gl, in);
  gl->abandon();
  CHECK_THROWS_AS(draw(*gl, in), std::runtime_error);
  const auto textures = [] {
    int count = 0;
    for (GLuint name = 1; name < 200; ++name) count += glIsTexture(name);
    return count;
  };
  const int before = textures();
  CHECK(before > 0);
  gl.reset();
  CHECK(textures() == before);
}

TEST_CASE("present gives every kind of framebuffer the same codes") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  const auto gl = make_gl_renderer(CurrentContext{});
  draw(*gl, in);
  const Image<std::uint8_t> image = gl->image();
  struct Kind {
    GLenum format;
    int samples, scale;
    bool encoding = true;  // the caller has not switched it off
  };
  for (const Kind& kind : {Kind{GL_RGBA8, 0, 2}, Kind{GL_RGBA8, 4, 1}, Kind{GL_SRGB8_ALPHA8, 0, 1},
                           Kind{GL_SRGB8_ALPHA8, 4, 2}, Kind{GL_SRGB8_ALPHA8, 0, 1, false}}) {
    CAPTURE(kind.format);
    CAPTURE(kind.samples);
    CAPTURE(kind.scale);
    const int width = kind.scale * kWidth, height = kind.scale * kHeight;
    GLuint framebuffers[2], renderbuffers[2];
    glGenFramebuffers(2, framebuffers), glGenRenderbuffers(2, renderbuffers);
    for (int i = 0; i < 2; ++i) {  // the caller's, and one sample of it to read
      glBindFramebuffer(GL_FRAMEBUFFER, framebuffers[i]);
      glBindRenderbuffer(GL_RENDERBUFFER, renderbuffers[i]);
      glRenderbufferStorageMultisample(GL_RENDERBUFFER, i == 0 ? kind.samples : 0, kind.format,
                                       width, height);
      glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER,
                                renderbuffers[i]);
    }
    if (!kind.encoding) {
      if (!epoxy_has_gl_extension("GL_EXT_sRGB_write_control")) continue;
      glDisable(GL_FRAMEBUFFER_SRGB_EXT);
    }
    glEnable(GL_SAMPLE_MASK), glSampleMaski(0, 1);
    gl->present(framebuffers[0], width, height);
    CHECK(glIsEnabled(GL_SAMPLE_MASK));
    glDisable(GL_SAMPLE_MASK);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffers[0]);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffers[1]);
    glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffers[1]);
    Image<std::uint8_t> shown(width, height, 4);
    glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, shown.data.data());
    // Twice as large, the four pixels around a corner mix 9 : 3 : 3 : 1.
    int worst = 0;
    for (int y = 1; y + 1 < height; ++y)
      for (int x = 1; x + 1 < width; ++x)
        for (int c = 0; c < 3; ++c) {
          const int s = kind.scale, row = height - 1 - y, i = x / s, j = row / s;
          double code = image.pixel(i, j)[c];
          if (s == 2) {
            const int k = x % 2 ? i + 1 : i - 1, l = row % 2 ? j + 1 : j - 1;
            code = (9 * code + 3 * image.pixel(k, j)[c] + 3 * image.pixel(i, l)[c] +
                    image.pixel(k, l)[c]) /
                   16;
          }
          worst = std::max(worst, int(std::abs(shown.pixel(x, y)[c] - code)));
        }
    CHECK(worst <= 1);
    glDeleteFramebuffers(2, framebuffers), glDeleteRenderbuffers(2, renderbuffers);
  }
  CHECK(glGetError() == GL_NO_ERROR);
  const auto own = make_gl_renderer();
  draw(*own, in);
  CHECK_THROWS_AS(own->present(0, kWidth, kHeight), std::invalid_argument);
}

namespace {

constexpr unsigned kFlat = GL_TEXTURE_2D, kExternal = GL_TEXTURE_EXTERNAL_OES;

// A matrix by its rows, as it is written.
glm::mat3 rows(glm::vec3 s, glm::vec3 t) { return glm::transpose(glm::mat3(s, t, {0, 0, 1})); }

// How a texture may hold a picture.
struct Layout {
  const char* name;
  int width, height;
  glm::mat3 uv_from_picture;
};
const Layout kLayouts[] = {
    {"row 0 first", kWidth, kHeight, glm::mat3(1)},
    {"upside down", kWidth, kHeight, rows({1, 0, 0}, {0, -1, 1})},
    {"mirrored", kWidth, kHeight, rows({-1, 0, 1}, {0, 1, 0})},
    {"turned to the right", kHeight, kWidth, rows({0, -1, 1}, {1, 0, 0})},
    {"turned to the left", kHeight, kWidth, rows({0, 1, 0}, {-1, 0, 1})},
    {"a part", 2 * kWidth, 4 * kHeight, rows({0.5f, 0, 0.25f}, {0, 0.25f, 0.5f})},
};

Image<std::uint8_t> rgb_of(const Image<std::uint8_t>& rgba) {
  Image<std::uint8_t> out(rgba.width, rgba.height, 3);
  for (std::size_t i = 0; i < rgba.data.size() / 4; ++i)
    std::copy_n(&rgba.data[4 * i], 3, &out.data[3 * i]);
  return out;
}

// The inputs' picture in a texture of the caller's, with the state that a new texture has: mipmaps
// that are not there. The rest of it is green.
GLuint texture_of(const Inputs& in, const Layout& layout, GLenum format = GL_RGBA8) {
  Image<std::uint8_t> texels(layout.width, layout.height, 4);
  for (std::size_t i = 1; i < texels.data.size(); i += 4) texels.data[i] = 255;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const glm::vec3 uv((float(x) + 0.5f) / float(kWidth), (float(y) + 0.5f) / float(kHeight), 1);
      const glm::vec3 st = layout.uv_from_picture * uv;
      std::copy_n(&in.pixels[std::size_t(3 * (y * kWidth + x))], 3,
                  texels.pixel(int(st.x * float(layout.width)), int(st.y * float(layout.height))));
    }
  GLint bound = 0, unpack = 0;
  glGetIntegerv(GL_TEXTURE_BINDING_2D, &bound);
  glGetIntegerv(GL_PIXEL_UNPACK_BUFFER_BINDING, &unpack);
  REQUIRE(unpack == 0);
  GLuint texture = 0;
  glGenTextures(1, &texture), glBindTexture(GL_TEXTURE_2D, texture);
  const GLenum channels = format == GL_SRGB8 ? GL_RGB : GL_RGBA;
  if (channels == GL_RGB) texels = rgb_of(texels);
  glTexImage2D(GL_TEXTURE_2D, 0, GLint(format), layout.width, layout.height, 0, channels,
               GL_UNSIGNED_BYTE, texels.data.data());
  glBindTexture(GL_TEXTURE_2D, GLuint(bound));
  return texture;
}

std::vector<GLint> parameters_of(GLuint texture) {
  std::vector<GLint> all;
  GLint bound = 0;
  glGetIntegerv(GL_TEXTURE_BINDING_2D, &bound);
  glBindTexture(GL_TEXTURE_2D, texture);
  for (const GLenum name :
       {GL_TEXTURE_MIN_FILTER, GL_TEXTURE_MAG_FILTER, GL_TEXTURE_WRAP_S, GL_TEXTURE_WRAP_T,
        GL_TEXTURE_COMPARE_MODE, GL_TEXTURE_BASE_LEVEL, GL_TEXTURE_MAX_LEVEL})
    glGetTexParameteriv(GL_TEXTURE_2D, name, &all.emplace_back());
  glBindTexture(GL_TEXTURE_2D, GLuint(bound));
  return all;
}

// The same texture, as a camera or a video decoder gives it; 0: the driver has none of them.
GLuint external_of(GLuint texture) {
  const char* of_display = eglQueryString(eglGetCurrentDisplay(), EGL_EXTENSIONS);
  if (!std::strstr(of_display, "EGL_KHR_gl_texture_2D_image") ||
      !epoxy_has_gl_extension("GL_OES_EGL_image_external_essl3"))
    return std::puts("skipped: no external textures"), 0;
  const EGLImageKHR image = eglCreateImageKHR(
      eglGetCurrentDisplay(), eglGetCurrentContext(), EGL_GL_TEXTURE_2D_KHR,
      reinterpret_cast<EGLClientBuffer>(std::uintptr_t{texture}), nullptr);  // NOLINT
  if (image == EGL_NO_IMAGE_KHR) return std::puts("skipped: no image of a texture"), 0;
  GLuint external = 0;
  GLint bound = 0;
  glGetIntegerv(GL_TEXTURE_BINDING_EXTERNAL_OES, &bound);
  glGenTextures(1, &external), glBindTexture(GL_TEXTURE_EXTERNAL_OES, external);
  glEGLImageTargetTexture2DOES(GL_TEXTURE_EXTERNAL_OES, image);
  eglDestroyImageKHR(eglGetCurrentDisplay(), image);
  glBindTexture(GL_TEXTURE_EXTERNAL_OES, GLuint(bound));
  return external;
}

Inputs without_picture(Inputs in) {
  in.back = {};
  return in;
}

}  // namespace

TEST_CASE("a caller's texture gives the picture that was uploaded gives, however it lies in it") {
  if (!have_egl()) return;
  const Inputs in = inputs(), bare = without_picture(in);
  const GlContext context;
  const GlContext::Current current(context);
  const auto uploads = make_gl_renderer(CurrentContext{}), gl = make_gl_renderer(CurrentContext{});
  draw(*uploads, in);
  const Image<std::uint8_t> image = uploads->image();
  uploads->clear(PassId::shadow);
  uploads->run(PassId::composite, in.input());
  const Image<std::uint8_t> unshadowed = uploads->image();
  Image<std::uint8_t> picture(kWidth, kHeight, 3);
  picture.data = in.pixels;
  const Window window;
  struct Kind {
    GLenum format;
    bool external;
  };
  for (const Kind& kind :
       {Kind{GL_RGBA8, false}, Kind{GL_SRGB8_ALPHA8, false}, Kind{GL_RGBA8, true}})
    for (const Layout& layout : kLayouts) {
      CAPTURE(kind.format);
      CAPTURE(kind.external);
      CAPTURE(std::string(layout.name));
      GLuint textures[] = {texture_of(in, layout, kind.format), 0};
      if (kind.external && !(textures[1] = external_of(textures[0]))) continue;
      const std::vector<GLint> parameters = parameters_of(textures[0]);
      const CameraTexture texture{textures[kind.external ? 1 : 0],
                                  kind.external ? kExternal : kFlat, layout.uv_from_picture};
      gl->set_back_texture(texture, in.camera);
      // It is read by now: what becomes of the texture does not matter. Nothing is drawn yet.
      CHECK(parameters_of(textures[0]) == parameters);
      glDeleteTextures(2, textures);
      CHECK(apart(gl->image(), picture) <= 1);
      gl->present(window.framebuffer, kWidth, kHeight);
      CHECK(window.shown() == gl->image());
      for (int frame = 0; frame < 2; ++frame) {  // the second is not drawn over the first
        draw(*gl, frame ? in : bare);
        CHECK(apart(gl->image(), image) <= 1);
        CHECK(gl->object() == uploads->object());
        gl->present(window.framebuffer, kWidth, kHeight);
        CHECK(window.shown() == gl->image());
      }
      gl->clear(PassId::shadow);  // a smaller part of the picture is drawn
      gl->run(PassId::composite, bare.input());
      CHECK(apart(gl->image(), unshadowed) <= 1);
    }
  // In a picture of half the size, each pixel is the mean of four texels.
  Camera half = in.camera;
  half.width /= 2, half.height /= 2;
  gl->set_back_texture({texture_of(in, kLayouts[0])}, half);
  const Image<std::uint8_t> small = gl->image();
  REQUIRE(small.width == kWidth / 2);
  double worst = 0;
  for (int y = 0; y < half.height; ++y)
    for (int x = 0; x < 3 * half.width; ++x) {
      const std::uint8_t *top = picture.row(2 * y), *below = picture.row(2 * y + 1);
      const int left = 6 * (x / 3) + x % 3, right = left + 3;
      const double mean = (top[left] + top[right] + below[left] + below[right]) / 4.0;
      worst = std::max(worst, std::abs(small.row(y)[x] - mean));
    }
  CHECK(worst <= 1);
  gl->clear_back_texture();
  CHECK(gl->image().data.empty());
  draw(*gl, in);
  CHECK(gl->image() == image);
  CHECK(glGetError() == GL_NO_ERROR);
}

TEST_CASE("a caller's texture is read under any state, which is put back") {
  if (!have_egl()) return;
  const Inputs in = inputs(), bare = without_picture(in);
  const GlContext context;
  const GlContext::Current current(context);
  const auto plain = make_gl_renderer(CurrentContext{});
  draw(*plain, in);
  const GLuint flat = texture_of(in, kLayouts[0]), external = external_of(flat);
  const Untidy untidy;
  if (external)  // each unit has one bound, too
    for (int unit = 0; unit < 16; ++unit) {
      glActiveTexture(GLenum(GL_TEXTURE0 + unit));
      glBindTexture(GL_TEXTURE_EXTERNAL_OES, external);
    }
  REQUIRE(glGetError() == GL_NO_ERROR);
  const std::vector<GLint> before = state();
  for (const CameraTexture& texture : {CameraTexture{flat}, {external, kExternal}}) {
    if (!texture.name) continue;
    const auto gl = make_gl_renderer(CurrentContext{});
    gl->set_back_texture(texture, in.camera);
    CHECK(state() == before);
    for (const PassId pass : kRenderPasses) {
      gl->run(pass, bare.input());
      CHECK(state() == before);
    }
    CHECK(apart(gl->image(), plain->image()) <= 1);
    CHECK(state() == before);
    gl->present(untidy.framebuffer, kWidth, kHeight);
    CHECK(state() == before);
  }
  CHECK(state() == before);
  while (glGetError() != GL_NO_ERROR) {
  }  // the untidy framebuffer is not complete
}

TEST_CASE("a caller's texture in desktop GL") {
  if (!have_egl()) return;
  const DesktopContext desktop;
  if (desktop.context == EGL_NO_CONTEXT) {
    std::puts("skipped: no desktop GL 4.5");
    return;
  }
  const Inputs in = inputs(), bare = without_picture(in);
  const auto uploads = make_gl_renderer(CurrentContext{}), gl = make_gl_renderer(CurrentContext{});
  draw(*uploads, in);
  for (const GLenum format : {GL_RGBA8, GL_SRGB8_ALPHA8, GL_SRGB8}) {
    const GLuint texture = texture_of(in, kLayouts[1], format);
    glEnable(GL_FRAMEBUFFER_SRGB), glClipControl(GL_UPPER_LEFT, GL_ZERO_TO_ONE);
    const std::vector<GLfloat> before = desktop_state();
    gl->set_back_texture({texture, kFlat, kLayouts[1].uv_from_picture}, in.camera);
    draw(*gl, bare);
    CHECK(apart(gl->image(), uploads->image()) <= 1);
    CHECK(desktop_state() == before);
    CHECK_THROWS_AS(gl->set_back_texture({texture, kExternal}, in.camera), std::runtime_error);
  }
  CHECK(glGetError() == GL_NO_ERROR);
}

TEST_CASE("what is no texture of a camera is refused, and the picture stays") {
  if (!have_egl()) return;
  const Inputs in = inputs(), bare = without_picture(in);
  const auto own = make_gl_renderer();
  const auto refuses = [&](GlRenderer& gl, const CameraTexture& texture, const char* why,
                           const Camera& camera) {
    CAPTURE(std::string(why));
    std::string said = "nothing";
    try {
      gl.set_back_texture(texture, camera);
    } catch (const std::invalid_argument& error) {
      said = error.what();
    }
    CHECK_MESSAGE(said.find(why) != std::string::npos, said);
  };
  refuses(*own, {1}, "caller's context", in.camera);
  const GlContext context;
  const GlContext::Current current(context);
  const auto gl = make_gl_renderer(CurrentContext{});
  const GLuint good = texture_of(in, kLayouts[0]);
  gl->set_back_texture({good}, in.camera);
  draw(*gl, bare);
  const Image<std::uint8_t> image = gl->image();

  GLuint names[4];
  glGenTextures(4, names);
  const auto [unborn, empty, cube, integers] = names;
  glBindTexture(GL_TEXTURE_2D, empty), glBindTexture(GL_TEXTURE_CUBE_MAP, cube);
  glBindTexture(GL_TEXTURE_2D, integers);
  glTexStorage2D(GL_TEXTURE_2D, 1, GL_RGBA8UI, kWidth, kHeight);
  refuses(*gl, {}, "no 2D texture 0", in.camera);
  refuses(*gl, {unborn}, "no 2D texture", in.camera);
  refuses(*gl, {cube}, "no 2D texture", in.camera);
  refuses(*gl, {12345}, "no 2D texture 12345", in.camera);
  if (epoxy_gl_version() >= 31) refuses(*gl, {empty}, "no picture", in.camera);
  refuses(*gl, {integers}, "integers", in.camera);
  refuses(*gl, {good, GL_TEXTURE_3D}, "GL_TEXTURE_2D (3553)", in.camera);
  if (const GLuint external = external_of(good)) {
    refuses(*gl, {external}, "no 2D texture", in.camera);
    refuses(*gl, {good, kExternal}, "no external texture", in.camera);
  }
  refuses(*gl, {good, kFlat, glm::transpose(kLayouts[1].uv_from_picture)}, "last row", in.camera);
  refuses(*gl, {good, kFlat, glm::mat3(std::numeric_limits<float>::quiet_NaN())}, "finite",
          in.camera);
  Camera wrong = in.camera;
  wrong.width = 0;
  refuses(*gl, {good}, "at least 1 × 1", wrong);
  GLint largest = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
  wrong.width = largest + 1;
  if (largest < 16384) refuses(*gl, {good}, "at most", wrong);
  CHECK(glGetError() == GL_NO_ERROR);
  CHECK(gl->image() == image);
  draw(*gl, bare);
  CHECK(gl->image() == image);

  Inputs other = bare;  // draws by another camera than the texture's
  other.camera.fx = 151;
  CHECK_THROWS_AS(draw(*gl, other), std::invalid_argument);
  gl->abandon();
  CHECK_THROWS_AS(gl->set_back_texture({good}, in.camera), std::runtime_error);
}

TEST_CASE("a session draws over a texture of its own size, and tracks in the frame's picture") {
  if (!have_egl()) return;
  const Inputs in = inputs();
  const GlContext context;
  const GlContext::Current current(context);
  const Window window;
  Inputs half = in;  // the same camera, at half the size: what is tracked and captured
  half.camera.width /= 2, half.camera.height /= 2;
  half.camera.fx /= 2, half.camera.fy /= 2, half.camera.cx /= 2, half.camera.cy /= 2;
  half.pixels.assign(std::size_t(kWidth / 2 * kHeight / 2 * 3), 90);
  half.back = {half.pixels.data(), PixelType::uint8, kWidth / 2, kHeight / 2, 0};

  auto made = make_gl_renderer(CurrentContext{});
  GlRenderer& gl = *made;
  SessionOptions options;
  options.read_back = false;
  Session session = session_of(half, std::move(made), options);
  Session uploads = session_of(in, make_gl_renderer(CurrentContext{}));
  Frame small = frame_of(half), lost = small, bare = small;
  lost.back_from_marker.reset(), bare.back = {};
  const Image<std::uint8_t> image = uploads.process(frame_of(in)).image;
  Image<std::uint8_t> picture(kWidth, kHeight, 3);
  picture.data = in.pixels;
  const PictureLayers layers = uploads.layers();
  session.process(small);  // without a texture
  CHECK(gl.image().width == kWidth / 2);
  for (int round = 0; round < 2; ++round) {
    CAPTURE(round);
    for (const Frame& frame : {small, lost, bare, small}) {
      gl.set_back_texture(
          {texture_of(in, kLayouts[2], GL_RGBA8), kFlat, kLayouts[2].uv_from_picture}, in.camera);
      const FrameResult result = session.process(frame);
      CHECK(result.image.width == 0);
      gl.present(window.framebuffer, kWidth, kHeight);
      CHECK(apart(window.shown(), frame.back_from_marker ? image : picture) <= 1);
    }
    const PictureLayers same = session.layers();
    CHECK(same.object == layers.object);
    CHECK(same.ratio == layers.ratio);
    gl.clear_back_texture();
    session.process(small);
    CHECK(gl.image().width == kWidth / 2);
  }
  CHECK(glGetError() == GL_NO_ERROR);
}
