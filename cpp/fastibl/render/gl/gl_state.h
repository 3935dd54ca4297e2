// The GL state that the renderer touches, saved for a caller in whose context it draws. Private to
// render/gl.
#pragma once

#include <epoxy/gl.h>

#include <array>
#include <vector>

namespace fastibl {

inline constexpr int kTextureUnits = 16;  // that passes may bind to: as many as ES 3.0 promises

// The state in a context that changes what passes draw. An engine may have set it.
struct ContextState {
  std::vector<GLenum> switches;       // each is off while passes draw
  std::vector<GLenum> stores;         // each is 0 then, or 1 where it is an alignment
  bool desktop = false;               // desktop GL
  bool clip_control = false;          // has a range of depths, and a side that is up
  bool polygon_mode = false;          // may draw triangles as lines
  bool srgb_switch = false;           // has OpenGL ES's switch for the encoding of what is drawn
  bool external = false;              // has external textures
  GLuint buffers = 0, viewports = 0;  // that have switches, masks or rectangles of their own

  ContextState();                            // of OpenGL ES 3.0: of a context of our own
  static ContextState of_current_context();  // with what its version and extensions add
};

class SavedState {
 public:
  explicit SavedState(const ContextState& context);  // which must outlive this
  ~SavedState();
  SavedState(const SavedState&) = delete;
  SavedState& operator=(const SavedState&) = delete;

 private:
  struct Unit {
    GLint flat, cube, external, sampler;
  };
  struct Buffer {
    GLboolean blends;
    std::array<GLint, 4> mask;
  };
  struct Viewport {
    std::array<GLfloat, 4> place;
    std::array<GLfloat, 2> depth_range;
    std::array<GLint, 4> scissor;
    GLboolean cut;
  };
  const ContextState& context_;
  std::vector<GLboolean> switches_;
  std::vector<GLint> stores_;
  std::vector<Buffer> buffers_;
  std::vector<Viewport> viewports_;
  std::array<Unit, kTextureUnits> units_;
  std::array<GLint, 4> viewport_, scissor_;
  std::array<GLboolean, 4> colour_mask_;
  std::array<GLfloat, 2> depth_range_;
  std::array<GLint, 2> polygon_mode_;
  GLint program_, vertex_array_, array_buffer_, draw_, read_, renderbuffer_, active_, pack_,
      unpack_, depth_function_, clip_origin_, clip_depth_, clamp_read_;
  GLboolean depth_mask_, seamless_, captures_;
};

// Sets the state that the passes assume; to be called after saving.
void set_default_state(const ContextState& context);

}  // namespace fastibl
