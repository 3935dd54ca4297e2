#include "fastibl/render/gl/gl_state.h"

#include <algorithm>

namespace fastibl {
namespace {

GLint integer(GLenum name) {
  GLint value = 0;
  glGetIntegerv(name, &value);
  return value;
}
void set(GLenum name, bool on) { on ? glEnable(name) : glDisable(name); }

void set_clip_control(const ContextState& context, GLenum origin, GLenum depth) {
  if (!context.clip_control) return;
  context.desktop ? glClipControl(origin, depth) : glClipControlEXT(origin, depth);
}

void set_polygon_mode(const ContextState& context, GLenum mode) {
  if (!context.polygon_mode) return;
  context.desktop ? glPolygonMode(GL_FRONT_AND_BACK, mode)
                  : glPolygonModeNV(GL_FRONT_AND_BACK, mode);
}

void set_depth_range(const ContextState& context, std::array<GLfloat, 2> range) {
  context.desktop ? glDepthRange(range[0], range[1]) : glDepthRangef(range[0], range[1]);
}

bool is_alignment(GLenum store) {
  return store == GL_UNPACK_ALIGNMENT || store == GL_PACK_ALIGNMENT;
}

}  // namespace

ContextState::ContextState()
    : switches{GL_SCISSOR_TEST,        GL_DEPTH_TEST,         GL_BLEND,
               GL_CULL_FACE,           GL_STENCIL_TEST,       GL_DITHER,
               GL_POLYGON_OFFSET_FILL, GL_RASTERIZER_DISCARD, GL_SAMPLE_ALPHA_TO_COVERAGE,
               GL_SAMPLE_COVERAGE},
      stores{GL_UNPACK_ALIGNMENT,   GL_UNPACK_ROW_LENGTH,   GL_UNPACK_SKIP_ROWS,
             GL_UNPACK_SKIP_PIXELS, GL_UNPACK_IMAGE_HEIGHT, GL_UNPACK_SKIP_IMAGES,
             GL_PACK_ALIGNMENT,     GL_PACK_ROW_LENGTH,     GL_PACK_SKIP_ROWS,
             GL_PACK_SKIP_PIXELS} {}

ContextState ContextState::of_current_context() {
  const auto has = [](const char* extension) { return epoxy_has_gl_extension(extension); };
  ContextState c;
  const int version = epoxy_gl_version();
  c.desktop = epoxy_is_desktop_gl();
  c.clip_control =
      c.desktop ? version >= 45 || has("GL_ARB_clip_control") : has("GL_EXT_clip_control");
  c.polygon_mode = c.desktop || has("GL_NV_polygon_mode");
  c.srgb_switch = !c.desktop && has("GL_EXT_sRGB_write_control");
  c.external = !c.desktop && has("GL_OES_EGL_image_external_essl3");
  if (c.desktop || version >= 32 || has("GL_EXT_draw_buffers_indexed") ||
      has("GL_OES_draw_buffers_indexed"))
    c.buffers = GLuint(std::min(integer(GL_MAX_DRAW_BUFFERS), 8));
  if (c.desktop || has("GL_OES_viewport_array")) c.viewports = GLuint(integer(GL_MAX_VIEWPORTS));
  const auto off = [&](GLenum name, bool there) {
    if (there) c.switches.push_back(name);
  };
  if (c.desktop || has("GL_EXT_clip_cull_distance") || has("GL_APPLE_clip_distance"))
    for (int i = 0; i < integer(GL_MAX_CLIP_DISTANCES); ++i)
      off(GLenum(GL_CLIP_DISTANCE0 + i), true);
  off(GL_SAMPLE_MASK, c.desktop || version >= 31);
  if (has("GL_ANGLE_pack_reverse_row_order")) c.stores.push_back(GL_PACK_REVERSE_ROW_ORDER_ANGLE);
  if (!c.desktop) return c;
  off(GL_ALPHA_TEST, integer(GL_CONTEXT_PROFILE_MASK) & GL_CONTEXT_COMPATIBILITY_PROFILE_BIT);
  for (const GLenum name :
       {GL_COLOR_LOGIC_OP, GL_FRAMEBUFFER_SRGB, GL_DEPTH_CLAMP, GL_POLYGON_SMOOTH})
    off(name, true);
  c.stores.insert(c.stores.end(), {GL_UNPACK_SWAP_BYTES, GL_PACK_SWAP_BYTES});
  return c;
}

SavedState::SavedState(const ContextState& context) : context_(context) {
  // While it captures vertices, no other program can be used.
  captures_ = integer(GL_TRANSFORM_FEEDBACK_ACTIVE) && !integer(GL_TRANSFORM_FEEDBACK_PAUSED);
  if (captures_) glPauseTransformFeedback();
  for (const GLenum name : context.switches) switches_.push_back(glIsEnabled(name));
  for (const GLenum name : context.stores) stores_.push_back(integer(name));
  if (context.desktop) {
    seamless_ = glIsEnabled(GL_TEXTURE_CUBE_MAP_SEAMLESS);
    clamp_read_ = integer(GL_CLAMP_READ_COLOR);
  }
  if (context.polygon_mode) glGetIntegerv(GL_POLYGON_MODE, polygon_mode_.data());
  if (context.clip_control)
    clip_origin_ = integer(GL_CLIP_ORIGIN), clip_depth_ = integer(GL_CLIP_DEPTH_MODE);
  for (GLuint i = 0; i < context.buffers; ++i) {
    Buffer& buffer = buffers_.emplace_back();
    buffer.blends = glIsEnabledi(GL_BLEND, i);
    glGetIntegeri_v(GL_COLOR_WRITEMASK, i, buffer.mask.data());
  }
  for (GLuint i = 0; i < context.viewports; ++i) {
    Viewport& v = viewports_.emplace_back();
    glGetFloati_v(GL_VIEWPORT, i, v.place.data());
    glGetFloati_v(GL_DEPTH_RANGE, i, v.depth_range.data());
    glGetIntegeri_v(GL_SCISSOR_BOX, i, v.scissor.data());
    v.cut = glIsEnabledi(GL_SCISSOR_TEST, i);
  }
  active_ = integer(GL_ACTIVE_TEXTURE);
  for (std::size_t i = 0; i < kTextureUnits; ++i) {
    glActiveTexture(GLenum(GL_TEXTURE0 + i));
    units_[i] = {integer(GL_TEXTURE_BINDING_2D), integer(GL_TEXTURE_BINDING_CUBE_MAP),
                 context.external ? integer(GL_TEXTURE_BINDING_EXTERNAL_OES) : 0,
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
  for (std::size_t i = 0; i < switches_.size(); ++i) set(context_.switches[i], switches_[i]);
  for (std::size_t i = 0; i < stores_.size(); ++i) glPixelStorei(context_.stores[i], stores_[i]);
  if (context_.desktop) {
    set(GL_TEXTURE_CUBE_MAP_SEAMLESS, seamless_);
    glClampColor(GL_CLAMP_READ_COLOR, GLenum(clamp_read_));
  }
  set_polygon_mode(context_, GLenum(polygon_mode_[0]));
  set_clip_control(context_, GLenum(clip_origin_), GLenum(clip_depth_));
  for (std::size_t i = 0; i < kTextureUnits; ++i) {
    glActiveTexture(GLenum(GL_TEXTURE0 + i));
    glBindTexture(GL_TEXTURE_2D, GLuint(units_[i].flat));
    glBindTexture(GL_TEXTURE_CUBE_MAP, GLuint(units_[i].cube));
    if (context_.external) glBindTexture(GL_TEXTURE_EXTERNAL_OES, GLuint(units_[i].external));
    glBindSampler(GLuint(i), GLuint(units_[i].sampler));
  }
  glActiveTexture(GLenum(active_));
  // For all buffers and viewports alike, then for those that have their own.
  glViewport(viewport_[0], viewport_[1], viewport_[2], viewport_[3]);
  glScissor(scissor_[0], scissor_[1], scissor_[2], scissor_[3]);
  glColorMask(colour_mask_[0], colour_mask_[1], colour_mask_[2], colour_mask_[3]);
  for (GLuint i = 0; i < buffers_.size(); ++i) {
    const auto& [blends, m] = buffers_[i];
    blends ? glEnablei(GL_BLEND, i) : glDisablei(GL_BLEND, i);
    glColorMaski(i, m[0] != 0, m[1] != 0, m[2] != 0, m[3] != 0);
  }
  set_depth_range(context_, depth_range_);
  for (GLuint i = 0; i < viewports_.size(); ++i) {
    const Viewport& v = viewports_[i];
    glViewportIndexedfv(i, v.place.data());
    glScissorIndexedv(i, v.scissor.data());
    v.cut ? glEnablei(GL_SCISSOR_TEST, i) : glDisablei(GL_SCISSOR_TEST, i);
    context_.desktop ? glDepthRangeIndexed(i, v.depth_range[0], v.depth_range[1])
                     : glDepthRangeIndexedfOES(i, v.depth_range[0], v.depth_range[1]);
  }
  glDepthMask(depth_mask_);
  glDepthFunc(GLenum(depth_function_));
  // One that is marked for deletion is gone once another is used.
  glUseProgram(glIsProgram(GLuint(program_)) ? GLuint(program_) : 0);
  if (captures_) glResumeTransformFeedback();
  glBindVertexArray(GLuint(vertex_array_));
  glBindBuffer(GL_ARRAY_BUFFER, GLuint(array_buffer_));
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, GLuint(draw_));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, GLuint(read_));
  glBindRenderbuffer(GL_RENDERBUFFER, GLuint(renderbuffer_));
  glBindBuffer(GL_PIXEL_PACK_BUFFER, GLuint(pack_));
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, GLuint(unpack_));
}

void set_default_state(const ContextState& context) {
  for (const GLenum name : context.switches) glDisable(name);
  for (const GLenum name : context.stores) glPixelStorei(name, is_alignment(name) ? 1 : 0);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0), glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_TRUE);
  glDepthFunc(GL_LESS);
  if (context.desktop) {
    glEnable(GL_TEXTURE_CUBE_MAP_SEAMLESS);
    glClampColor(GL_CLAMP_READ_COLOR, GL_FIXED_ONLY);
  }
  set_depth_range(context, {0, 1});
  set_polygon_mode(context, GL_FILL);
  set_clip_control(context, GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
  for (GLuint i = 0; i < GLuint(kTextureUnits); ++i) glBindSampler(i, 0);
}

}  // namespace fastibl
