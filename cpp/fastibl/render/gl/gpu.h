// The context that the passes draw in, its limits, and the objects made in it. Private to
// render/gl.
#pragma once

#include <epoxy/gl.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/render/gl/context.h"
#include "fastibl/render/gl/gl_state.h"
#include "fastibl/render/gl/shaders.h"

namespace fastibl {

struct Texture {  // deleted by the Gpu that made it
  GLuint id = 0;
  int width = 0, height = 0;
};

class Gpu {
 public:
  // Throws std::runtime_error where there is no context, or it is too old or has no float targets.
  explicit Gpu(bool own_context);
  ~Gpu();
  Gpu(const Gpu&) = delete;
  Gpu& operator=(const Gpu&) = delete;

  // Makes our context current, or saves the caller's state. All other calls are within one. Throws
  // std::runtime_error where another context than the caller's is current.
  class Scope {
   public:
    explicit Scope(const Gpu& gpu);

   private:
    std::optional<GlContext::Current> current_;
    std::optional<SavedState> saved_;
  };

  bool own_context() const { return context_.has_value(); }
  void abandon() { abandoned_ = true; }  // the context is gone
  const ContextState& state() const { return state_; }
  const std::string& device() const { return device_; }
  int largest() const { return largest_; }     // edge of a texture, texels
  // Throws std::invalid_argument for a texture, or a cube map's face, beyond the driver's limit.
  void check_size(int width, int height) const;
  void check_face(int size) const;
  bool half() const { return half_; }          // light is stored in half floats
  bool bake_all() const { return bake_all_; }  // no diffuse method has a shader of its own

  GLuint new_texture();
  GLuint new_buffer();
  GLuint new_vertex_array();

  // Makes the texture if needed, and fills it if there is data.
  void allocate(Texture& t, GLenum internal, int width, int height, GLenum format, GLenum type,
                const void* data = nullptr);
  void remove(Texture& t);  // t is no texture afterwards
  void allocate_depth(int width, int height);

  // Makes framebuffer 0 or 1 draw to this texture, and read from it.
  void target(int which, const Texture& t, bool depth = false);
  GLuint framebuffer(int which) const { return framebuffers_[which]; }
  Image<float> read(const Texture& t, int width, int height);

  // The program of the pass's two shaders, made at its first use; it is in use from now on.
  const Program& use(const std::string& pass, const std::vector<std::string>& defines);
  void bind(const char* sampler, const Texture& t, GLenum kind = GL_TEXTURE_2D);
  // A texture of the caller's, read between its texels whatever its own state says, to the end of
  // the scope. False where there is none of this kind under the name.
  bool bind_given(const char* sampler, GLuint name, GLenum kind);
  void draw_full_screen(int width, int height);

 private:
  std::optional<GlContext> context_;  // none: the caller's
  const void* caller_ = nullptr;      // the caller's
  bool abandoned_ = false;
  ContextState state_;
  std::string device_;
  bool half_ = false, bake_all_ = false;
  int largest_ = 2048, largest_face_ = 2048;
  GLuint framebuffers_[2] = {}, depth_ = 0, no_corners_ = 0, smooth_ = 0;
  std::vector<GLuint> textures_, buffers_, vertex_arrays_;
  std::map<std::string, Program> programs_;
};

// Sets the filters of the bound texture, and clamps it at its edges.
void set_sampling(GLenum kind, GLenum filter, GLenum reduce);

}  // namespace fastibl
