#include "fastibl/render/gl/gpu.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

// Which texture unit a sampler reads; no program has two samplers of the same unit.
constexpr std::pair<const char*, int> kUnits[] = {
    {"radiance", 0},      {"visible", 1},        {"triangles", 2},     {"vertices", 3},
    {"shares", 4},        {"albedo_table", 5},   {"spheres", 1},       {"response", 0},
    {"guess", 1},         {"back", 2},           {"object", 3},        {"ratio_map", 4},
    {"outer_map", 6},     {"fine_map", 7},       {"rays", 5},          {"baked", 6},
    {"chain", 7},         {"first_lobe", 8},     {"holdout", 8},       {"lobe_table", 9},
    {"normal_map", 9},    {"uvs", 10},           {"tangents", 11},     {"base_color_map", 12},
    {"metallic_map", 13}, {"roughness_map", 14}, {"emission_map", 15}, {"ggx_albedo", 5},
    {"linear_back", 9},   {"screen", 0},         {"given", 2},         {"large", 1},
    {"pixel_shares", 4},  {"entries", 5},        {"lobe_masks", 7},    {"bright", 8},
    {"tree", 9},          {"lobe_cells", 10},    {"self_shares", 11},   {"near_lights", 12},
    {"near_entries", 13}, {"near_radiance", 7}};
static_assert(std::ranges::all_of(kUnits, [](const auto& u) { return u.second < kTextureUnits; }),
              "a unit whose state is not given back");

int unit_of(const char* sampler) {
  const auto* found =
      std::ranges::find_if(kUnits, [&](const auto& u) { return !std::strcmp(u.first, sampler); });
  check(found != std::end(kUnits), "no texture unit is set aside for ", sampler);
  return found->second;
}

std::string text_of(GLenum what) {
  const GLubyte* text = glGetString(what);
  return text ? reinterpret_cast<const char*>(text) : "";
}

void check_version() {
  if (epoxy_gl_version() < (epoxy_is_desktop_gl() ? 43 : 30))
    throw std::runtime_error("the GL back end needs OpenGL ES 3.0 or OpenGL 4.3, got " +
                             text_of(GL_VERSION));
}

bool asked(const char* variable) {
  const char* value = std::getenv(variable);
  return value && *value && *value != '0';
}

}  // namespace

Gpu::Scope::Scope(const Gpu& gpu) {
  if (gpu.abandoned_) throw std::runtime_error("the renderer's GL context was abandoned");
  if (!gpu.context_ && current_context() != gpu.caller_)
    throw std::runtime_error("the GL context in which the renderer was made is not current");
  if (gpu.context_)
    current_.emplace(*gpu.context_);
  else
    saved_.emplace(gpu.state_);
  set_default_state(gpu.state_);
}

Gpu::Gpu(bool own_context) {
  if (own_context) {
    context_.emplace();
  } else {
    // Looked at first: without it, or without a call that an old one lacks, libepoxy would abort.
    caller_ = current_context();
    if (!caller_) throw std::runtime_error("no GL context is current");
    check_version();
    state_ = ContextState::of_current_context();
  }
  const Scope scope(*this);
  check_version();
  device_ = text_of(GL_RENDERER);
  const bool desktop = state_.desktop;
  if (!desktop && !epoxy_has_gl_extension("GL_EXT_color_buffer_float"))
    throw std::runtime_error("the GL driver \"" + device_ +
                             "\" cannot draw to float textures (EXT_color_buffer_float)");
  bake_all_ = asked("FASTIBL_GL_BAKED");
  half_ = asked("FASTIBL_GL_HALF") ||
          !(desktop || epoxy_has_gl_extension("GL_OES_texture_float_linear"));
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest_);
  glGetIntegerv(GL_MAX_CUBE_MAP_TEXTURE_SIZE, &largest_face_);
  glGenFramebuffers(2, framebuffers_);
  glGenRenderbuffers(1, &depth_);
  no_corners_ = new_vertex_array();
  glGenSamplers(1, &smooth_);
  for (const GLenum filter : {GL_TEXTURE_MIN_FILTER, GL_TEXTURE_MAG_FILTER})
    glSamplerParameteri(smooth_, filter, GL_LINEAR);
  for (const GLenum edge : {GL_TEXTURE_WRAP_S, GL_TEXTURE_WRAP_T})
    glSamplerParameteri(smooth_, edge, GL_CLAMP_TO_EDGE);
}

Gpu::~Gpu() {
  if (context_) return;  // it takes all objects with it
  // In another context, these names are those of somebody else's objects.
  if (abandoned_ || current_context() != caller_) return;
  glDeleteTextures(GLsizei(textures_.size()), textures_.data());
  for (const auto& [key, program] : programs_) glDeleteProgram(program.id());
  glDeleteFramebuffers(2, framebuffers_);
  glDeleteVertexArrays(GLsizei(vertex_arrays_.size()), vertex_arrays_.data());
  glDeleteBuffers(GLsizei(buffers_.size()), buffers_.data());
  glDeleteRenderbuffers(1, &depth_);
  glDeleteSamplers(1, &smooth_);
}

GLuint Gpu::new_texture() {
  glGenTextures(1, &textures_.emplace_back());
  return textures_.back();
}

GLuint Gpu::new_buffer() {
  glGenBuffers(1, &buffers_.emplace_back());
  return buffers_.back();
}

GLuint Gpu::new_vertex_array() {
  glGenVertexArrays(1, &vertex_arrays_.emplace_back());
  return vertex_arrays_.back();
}

void Gpu::check_size(int width, int height) const {
  check(width <= largest_ && height <= largest_, "the GL driver's textures have at most ", largest_,
        " texels along an edge, got ", width, " × ", height);
}

void Gpu::check_face(int size) const {
  check(size <= largest_face_, "the GL driver's cube maps have faces of at most ", largest_face_,
        " texels along an edge, got ", size);
}

void Gpu::allocate(Texture& t, GLenum internal, int width, int height, GLenum format, GLenum type,
                   const void* data) {
  check_size(width, height);
  glActiveTexture(GL_TEXTURE0);
  if (!t.id) t.id = new_texture();
  glBindTexture(GL_TEXTURE_2D, t.id);
  if (t.width != width || t.height != height) {
    glTexImage2D(GL_TEXTURE_2D, 0, GLint(internal), width, height, 0, format, type, data);
    set_sampling(GL_TEXTURE_2D, GL_NEAREST, GL_NEAREST);
    t.width = width, t.height = height;
  } else if (data) {
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, format, type, data);
  }
}

void Gpu::remove(Texture& t) {
  if (t.id) {
    glDeleteTextures(1, &t.id);
    std::erase(textures_, t.id);
  }
  t = {};
}

void Gpu::allocate_depth(int width, int height) {
  glBindRenderbuffer(GL_RENDERBUFFER, depth_);
  glRenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT24, width, height);
}

void Gpu::target(int which, const Texture& t, bool depth) {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffers_[which]);
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, t.id, 0);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER,
                            depth ? depth_ : 0);
}

Image<float> Gpu::read(const Texture& t, int width, int height) {
  Image<float> out(width, height, 4);
  target(0, t);
  glReadPixels(0, 0, width, height, GL_RGBA, GL_FLOAT, out.data.data());
  return out;
}

const Program& Gpu::use(const std::string& pass, const std::vector<std::string>& defines) {
  std::string key = pass;
  for (const std::string& define : defines) key += "," + define;
  auto found = programs_.find(key);
  if (found == programs_.end()) {
    found =
        programs_.emplace(key, Program(pass + ".vert.glsl", pass + ".frag.glsl", defines)).first;
    glUseProgram(found->second.id());
    for (const auto& [sampler, unit] : kUnits) glUniform1i(found->second.uniform(sampler), unit);
  }
  glUseProgram(found->second.id());
  return found->second;
}

void Gpu::bind(const char* sampler, const Texture& t, GLenum kind) {
  glActiveTexture(GLenum(GL_TEXTURE0 + unit_of(sampler)));
  glBindTexture(kind, t.id);
}

bool Gpu::bind_given(const char* sampler, GLuint name, GLenum kind) {
  if (!glIsTexture(name)) return false;
  const int unit = unit_of(sampler);
  glActiveTexture(GLenum(GL_TEXTURE0 + unit));
  glBindTexture(kind, 0), glBindTexture(kind, name);
  GLint bound = 0;
  glGetIntegerv(kind == GL_TEXTURE_2D ? GL_TEXTURE_BINDING_2D : GL_TEXTURE_BINDING_EXTERNAL_OES,
                &bound);
  if (GLuint(bound) != name) return glGetError(), false;  // ours: it was made for another kind
  glBindSampler(GLuint(unit), smooth_);
  return true;
}

void Gpu::draw_full_screen(int width, int height) {
  glViewport(0, 0, width, height);
  glBindVertexArray(no_corners_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

void set_sampling(GLenum kind, GLenum filter, GLenum reduce) {
  glTexParameteri(kind, GL_TEXTURE_MAG_FILTER, GLint(filter));
  glTexParameteri(kind, GL_TEXTURE_MIN_FILTER, GLint(reduce));
  glTexParameteri(kind, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTexParameteri(kind, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}

}  // namespace fastibl
