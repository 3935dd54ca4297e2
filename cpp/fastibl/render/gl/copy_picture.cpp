#include "fastibl/render/gl/copy_picture.h"

#include <cmath>
#include <stdexcept>
#include <string>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

void check_affine(const glm::mat3& m) {
  bool finite = true;
  for (int i = 0; i < 9; ++i) finite = finite && std::isfinite(m[i / 3][i % 3]);
  check(finite && m[0][2] == 0 && m[1][2] == 0 && m[2][2] == 1,
        "uv_from_picture must be finite with the last row 0 0 1, got the last row ", m[0][2], " ",
        m[1][2], " ", m[2][2]);
}

// What the bound texture is, which framebuffer 0 then reads.
GLenum ask(GLenum what) {
  GLint value = 0;
  glGetFramebufferAttachmentParameteriv(GL_READ_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, what, &value);
  return GLenum(value);
}

// Whether the texture's format is sRGB, so that linear values are read from it.
bool check_format(Gpu& gpu, GLuint name) {
  if (epoxy_is_desktop_gl() || epoxy_gl_version() >= 31) {  // elsewhere it would be black
    GLint width = 0;
    glGetTexLevelParameteriv(GL_TEXTURE_2D, 0, GL_TEXTURE_WIDTH, &width);
    check(width > 0, "the texture ", name, " has no picture at its level 0");
  }
  gpu.target(0, {name});
  const GLenum type = ask(GL_FRAMEBUFFER_ATTACHMENT_COMPONENT_TYPE);
  check(type != GL_INT && type != GL_UNSIGNED_INT, "a camera's texture has values from 0 to 1; ",
        name, " has integers");
  return ask(GL_FRAMEBUFFER_ATTACHMENT_COLOR_ENCODING) == GL_SRGB;
}

}  // namespace

void copy_picture(Gpu& gpu, const CameraTexture& from, int width, int height, Texture& out) {
  const bool external = from.target == GL_TEXTURE_EXTERNAL_OES;
  check(external || from.target == GL_TEXTURE_2D,
        "a camera's texture is of GL_TEXTURE_2D (3553) or GL_TEXTURE_EXTERNAL_OES (36197), got ",
        from.target);
  check_affine(from.uv_from_picture);
  if (external && !gpu.state().external)
    throw std::runtime_error("the GL driver \"" + gpu.device() +
                             "\" reads no external textures (OES_EGL_image_external_essl3)");
  check(gpu.bind_given("given", from.name, from.target), "the context has no ",
        external ? "external" : "2D", " texture ", from.name);
  const bool linear = !external && check_format(gpu, from.name);
  gpu.allocate(out, GL_RGBA8, width, height, GL_RGBA, GL_UNSIGNED_BYTE);
  const Program& p =
      gpu.use("copy", {external ? "EXTERNAL 1" : "EXTERNAL 0", linear ? "LINEAR 1" : "LINEAR 0"});
  glUniform2f(p.uniform("size"), float(width), float(height));
  set(p, "uv_from_picture", from.uv_from_picture);
  gpu.target(0, out);
  gpu.draw_full_screen(width, height);
}

}  // namespace fastibl
