#include "fastibl/render/gl/gl_state.h"

namespace fastibl {
namespace {

GLint integer(GLenum name) {
  GLint value = 0;
  glGetIntegerv(name, &value);
  return value;
}
void set(GLenum name, bool on) { on ? glEnable(name) : glDisable(name); }

// Features that only desktop GL has.
bool has_viewports() { return epoxy_is_desktop_gl() && epoxy_gl_version() >= 41; }
bool has_clip_control() {
  return epoxy_is_desktop_gl() &&
         (epoxy_gl_version() >= 45 || epoxy_has_gl_extension("GL_ARB_clip_control"));
}

}  // namespace

SavedState::SavedState() {
  for (std::size_t i = 0; i < kSwitches.size(); ++i) switches_[i] = glIsEnabled(kSwitches[i]);
  for (std::size_t i = 0; i < kStores.size(); ++i) stores_[i] = integer(kStores[i]);
  if (epoxy_is_desktop_gl()) {
    for (std::size_t i = 0; i < kDesktopSwitches.size(); ++i)
      desktop_switches_[i] = glIsEnabled(kDesktopSwitches[i]);
    for (GLuint i = 0; i < kBuffers; ++i) {
      blends_[i] = glIsEnabledi(GL_BLEND, i);
      glGetBooleani_v(GL_COLOR_WRITEMASK, i, colour_masks_[i].data());
    }
    glGetIntegerv(GL_POLYGON_MODE, polygon_mode_.data());
  }
  if (has_viewports())
    for (GLuint i = 0; i < kViewports; ++i) {
      glGetFloati_v(GL_VIEWPORT, i, viewports_[i].data());
      glGetIntegeri_v(GL_SCISSOR_BOX, i, scissors_[i].data());
    }
  if (has_clip_control())
    clip_origin_ = integer(GL_CLIP_ORIGIN), clip_depth_ = integer(GL_CLIP_DEPTH_MODE);
  active_ = integer(GL_ACTIVE_TEXTURE);
  for (std::size_t i = 0; i < kTextureUnits; ++i) {
    glActiveTexture(GLenum(GL_TEXTURE0 + i));
    units_[i] = {integer(GL_TEXTURE_BINDING_2D), integer(GL_TEXTURE_BINDING_CUBE_MAP),
                 integer(GL_SAMPLER_BINDING)};
  }
  glActiveTexture(GLenum(active_));
  glGetIntegerv(GL_VIEWPORT, viewport_.data());
  glGetIntegerv(GL_SCISSOR_BOX, scissor_.data());
  glGetBooleanv(GL_COLOR_WRITEMASK, colour_mask_.data());
  glGetFloatv(GL_DEPTH_RANGE, depth_range_.data());
  glGetBooleanv(GL_DEPTH_WRITEMASK, &depth_mask_);
  program_ = integer(GL_CURRENT_PROGRAM);
  vertex_array_ = integer(GL_VERTEX_ARRAY_BINDING);
  array_buffer_ = integer(GL_ARRAY_BUFFER_BINDING);
  draw_ = integer(GL_DRAW_FRAMEBUFFER_BINDING), read_ = integer(GL_READ_FRAMEBUFFER_BINDING);
  renderbuffer_ = integer(GL_RENDERBUFFER_BINDING);
  pack_ = integer(GL_PIXEL_PACK_BUFFER_BINDING), unpack_ = integer(GL_PIXEL_UNPACK_BUFFER_BINDING);
  depth_function_ = integer(GL_DEPTH_FUNC);
}

SavedState::~SavedState() {
  for (std::size_t i = 0; i < kSwitches.size(); ++i) set(kSwitches[i], switches_[i]);
  for (std::size_t i = 0; i < kStores.size(); ++i) glPixelStorei(kStores[i], stores_[i]);
  if (epoxy_is_desktop_gl()) {
    for (std::size_t i = 0; i < kDesktopSwitches.size(); ++i)
      set(kDesktopSwitches[i], desktop_switches_[i]);
    for (GLuint i = 0; i < kBuffers; ++i)
      blends_[i] ? glEnablei(GL_BLEND, i) : glDisablei(GL_BLEND, i);
    glPolygonMode(GL_FRONT_AND_BACK, GLenum(polygon_mode_[0]));
  }
  if (has_clip_control()) glClipControl(GLenum(clip_origin_), GLenum(clip_depth_));
  for (std::size_t i = 0; i < kTextureUnits; ++i) {
    glActiveTexture(GLenum(GL_TEXTURE0 + i));
    glBindTexture(GL_TEXTURE_2D, GLuint(units_[i].flat));
    glBindTexture(GL_TEXTURE_CUBE_MAP, GLuint(units_[i].cube));
    glBindSampler(GLuint(i), GLuint(units_[i].sampler));
  }
  glActiveTexture(GLenum(active_));
  glViewport(viewport_[0], viewport_[1], viewport_[2], viewport_[3]);
  glScissor(scissor_[0], scissor_[1], scissor_[2], scissor_[3]);
  glColorMask(colour_mask_[0], colour_mask_[1], colour_mask_[2], colour_mask_[3]);
  if (epoxy_is_desktop_gl())
    for (GLuint i = 0; i < kBuffers; ++i) {
      const std::array<GLboolean, 4>& m = colour_masks_[i];
      glColorMaski(i, m[0], m[1], m[2], m[3]);
    }
  if (has_viewports()) {
    glViewportArrayv(0, kViewports, viewports_[0].data());
    glScissorArrayv(0, kViewports, scissors_[0].data());
  }
  if (epoxy_is_desktop_gl())
    glDepthRange(depth_range_[0], depth_range_[1]);
  else
    glDepthRangef(depth_range_[0], depth_range_[1]);
  glDepthMask(depth_mask_);
  glDepthFunc(GLenum(depth_function_));
  glUseProgram(GLuint(program_));
  glBindVertexArray(GLuint(vertex_array_));
  glBindBuffer(GL_ARRAY_BUFFER, GLuint(array_buffer_));
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, GLuint(draw_));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, GLuint(read_));
  glBindRenderbuffer(GL_RENDERBUFFER, GLuint(renderbuffer_));
  glBindBuffer(GL_PIXEL_PACK_BUFFER, GLuint(pack_));
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, GLuint(unpack_));
}

void set_default_state() {
  for (const GLenum name : {GL_SCISSOR_TEST, GL_DEPTH_TEST, GL_BLEND, GL_CULL_FACE, GL_STENCIL_TEST,
                            GL_DITHER, GL_POLYGON_OFFSET_FILL, GL_RASTERIZER_DISCARD,
                            GL_SAMPLE_ALPHA_TO_COVERAGE, GL_SAMPLE_COVERAGE})
    glDisable(name);
  for (const GLenum name :
       {GL_UNPACK_ROW_LENGTH, GL_UNPACK_SKIP_ROWS, GL_UNPACK_SKIP_PIXELS, GL_UNPACK_IMAGE_HEIGHT,
        GL_UNPACK_SKIP_IMAGES, GL_PACK_ROW_LENGTH, GL_PACK_SKIP_ROWS, GL_PACK_SKIP_PIXELS})
    glPixelStorei(name, 0);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1), glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0), glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_TRUE);
  glDepthFunc(GL_LESS);
  if (epoxy_is_desktop_gl()) {
    glDepthRange(0, 1);
    glEnable(GL_TEXTURE_CUBE_MAP_SEAMLESS);
    for (const GLenum name : {GL_COLOR_LOGIC_OP, GL_FRAMEBUFFER_SRGB, GL_DEPTH_CLAMP})
      glDisable(name);
    glPolygonMode(GL_FRONT_AND_BACK, GL_FILL);
    if (has_clip_control()) glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
  } else {
    glDepthRangef(0, 1);
  }
  for (GLuint i = 0; i < GLuint(kTextureUnits); ++i) glBindSampler(i, 0);
}

}  // namespace fastibl
