// The GL state that the renderer touches, saved for a caller in whose context it draws. Private to
// render/gl.
#pragma once

#include <epoxy/gl.h>

#include <array>

namespace fastibl {

inline constexpr int kTextureUnits = 16;  // that passes may bind to: as many as ES 3.0 promises

class SavedState {
 public:
  SavedState();
  ~SavedState();
  SavedState(const SavedState&) = delete;
  SavedState& operator=(const SavedState&) = delete;

 private:
  static constexpr std::array kSwitches = {
      GL_SCISSOR_TEST,        GL_DEPTH_TEST,         GL_BLEND,
      GL_CULL_FACE,           GL_STENCIL_TEST,       GL_DITHER,
      GL_POLYGON_OFFSET_FILL, GL_RASTERIZER_DISCARD, GL_SAMPLE_ALPHA_TO_COVERAGE,
      GL_SAMPLE_COVERAGE};
  static constexpr std::array kStores = {
      GL_UNPACK_ALIGNMENT,    GL_UNPACK_ROW_LENGTH,  GL_UNPACK_SKIP_ROWS, GL_UNPACK_SKIP_PIXELS,
      GL_UNPACK_IMAGE_HEIGHT, GL_UNPACK_SKIP_IMAGES, GL_PACK_ALIGNMENT,   GL_PACK_ROW_LENGTH,
      GL_PACK_SKIP_ROWS,      GL_PACK_SKIP_PIXELS};
  struct Unit {
    GLint flat, cube, sampler;
  };
  static constexpr std::array kDesktopSwitches = {GL_TEXTURE_CUBE_MAP_SEAMLESS, GL_COLOR_LOGIC_OP,
                                                  GL_FRAMEBUFFER_SRGB, GL_DEPTH_CLAMP};
  static constexpr GLuint kBuffers = 8, kViewports = 16;  // as many as desktop GL promises
  std::array<GLboolean, kSwitches.size()> switches_;
  std::array<GLboolean, kDesktopSwitches.size()> desktop_switches_;
  std::array<GLboolean, kBuffers> blends_;
  std::array<std::array<GLboolean, 4>, kBuffers> colour_masks_;
  std::array<std::array<GLfloat, 4>, kViewports> viewports_;
  std::array<std::array<GLint, 4>, kViewports> scissors_;
  std::array<GLint, 2> polygon_mode_;
  GLint clip_origin_, clip_depth_;
  std::array<GLint, kStores.size()> stores_;
  std::array<Unit, kTextureUnits> units_;
  std::array<GLint, 4> viewport_, scissor_;
  std::array<GLboolean, 4> colour_mask_;
  std::array<GLfloat, 2> depth_range_;
  GLint program_, vertex_array_, array_buffer_, draw_, read_, renderbuffer_, active_, pack_,
      unpack_, depth_function_;
  GLboolean depth_mask_;
};

// Sets the state that the passes assume; to be called after saving.
void set_default_state();

}  // namespace fastibl
