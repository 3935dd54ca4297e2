#include "fastibl/render/gl/gl_renderer.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <optional>

#include "fastibl/render/gl/context.h"
#include "fastibl/render/gl/gl_state.h"
#include "fastibl/render/gl/outline.h"
#include "fastibl/render/gl/shaders.h"
#include "fastibl/scene/shared_formulas.h"
#include "fastibl/shading/shade.h"
#include "fastibl/shadow/sphere_shadow.h"

namespace fastibl {
namespace {

constexpr int kRow = 1024;       // texels along a row of the mesh's textures, as in shade.frag.glsl
constexpr int kBaked = 5;        // variant that reads the irradiance from a cube map
constexpr int kBakedSize = 32;   // of its faces: bilinear, 0.1 % from the method itself
constexpr int kResolution = 64;  // of the shadow map
constexpr int kGuessRow = 64;    // 64² = 4096 guesses of a code
constexpr float kHalfMax = 32768;
// The four samples of a pixel in 1/256, where GPUs and the CPU's rasteriser put them.
constexpr int kSampleX[4] = {96, 224, 32, 160}, kSampleY[4] = {32, 96, 160, 224};

// Which texture unit a sampler reads; no program has two of the same unit.
constexpr std::pair<const char*, int> kUnits[] = {
    {"radiance", 0},     {"visible", 1},   {"triangles", 2}, {"vertices", 3}, {"normals", 4},
    {"albedo_table", 5}, {"spheres", 1},   {"response", 0},  {"guess", 1},    {"back", 2},
    {"object", 3},       {"ratio_map", 4}, {"rays", 5},      {"baked", 6}};

struct Texture {
  GLuint id = 0;
  int width = 0, height = 0;
};

template <typename T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

bool lit(glm::vec3 colour) { return colour != glm::vec3(0); }

int diffuse_variant(DiffuseMethod method) {
  switch (method) {
    case DiffuseMethod::nearest_face:
      return 1;
    case DiffuseMethod::six_face:
      return 2;
    case DiffuseMethod::six_face_exact:
      return 3;
    case DiffuseMethod::sh9:
      return 4;
    default:
      return kBaked;
  }
}

class Gl final : public GlRenderer {
 public:
  explicit Gl(bool own_context) {
    if (own_context) context_.emplace();
    const Scope scope(*this);
    // Asked once here: a library without a current context would abort on the first call.
    const std::string version = text_of(GL_VERSION);
    device_ = text_of(GL_RENDERER);
    const bool desktop = epoxy_is_desktop_gl();
    if (epoxy_gl_version() < (desktop ? 43 : 30))
      throw std::runtime_error("the GL back end needs OpenGL ES 3.0 or OpenGL 4.3, got " + version);
    if (!desktop && !epoxy_has_gl_extension("GL_EXT_color_buffer_float"))
      throw std::runtime_error("the GL driver \"" + device_ +
                               "\" cannot draw to float textures (EXT_color_buffer_float)");
    const auto asked = [](const char* variable) {
      const char* value = std::getenv(variable);
      return value && *value && *value != '0';
    };
    bake_all_ = asked("FASTIBL_GL_BAKED");
    half_ = asked("FASTIBL_GL_HALF") ||
            !(desktop || epoxy_has_gl_extension("GL_OES_texture_float_linear"));
    GLint limit = 2048;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &limit);
    largest_ = limit;
    glGenFramebuffers(2, framebuffers_);
    glGenVertexArrays(3, vertex_arrays_);
    glGenBuffers(2, buffers_);
    glGenRenderbuffers(1, &depth_);
    for (int i = 0; i < 2; ++i) {  // the whole mesh, and the part of it before the camera
      glBindVertexArray(vertex_arrays_[i]);
      glBindBuffer(GL_ARRAY_BUFFER, buffers_[i]);
      glEnableVertexAttribArray(0), glEnableVertexAttribArray(1);
      glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(Corner), nullptr);
      glVertexAttribIPointer(1, 1, GL_UNSIGNED_INT, sizeof(Corner),
                             reinterpret_cast<const void*>(sizeof(glm::vec3)));
    }
  }

  ~Gl() override {
    if (context_) return;  // takes all objects with it
    for (Texture* t :
         {&cube_, &baked_, &ratio_, &spheres_, &visible_, &triangles_, &vertices_, &normals_,
          &albedo_, &object_, &back_, &picture_, &screen_, &response_, &guess_, &rays_})
      glDeleteTextures(1, &t->id);
    for (const auto& [key, program] : programs_) glDeleteProgram(program.id());
    glDeleteFramebuffers(2, framebuffers_);
    glDeleteVertexArrays(3, vertex_arrays_);
    glDeleteBuffers(2, buffers_);
    glDeleteRenderbuffers(1, &depth_);
  }

  std::string_view backend() const override { return "gl"; }
  std::string device() const override { return device_; }

  void run(PassId pass, const RenderInput& in) override {
    const Scope scope(*this);
    switch (pass) {
      case PassId::shadow:
        shadow(in);
        break;
      case PassId::shade:
        shade(in);
        break;
      case PassId::composite:
        composite(in);
        break;
      default:
        check(false, "the GL back end has no pass ", name(pass));
    }
    if (!context_) return;
    // So that timings are of the work. Nothing is lost: the image is read back anyway.
    glFinish();
    const GLenum error = glGetError();
    if (error != GL_NO_ERROR)
      throw std::runtime_error("GL error " + std::to_string(error) + " in the pass " +
                               std::string(name(pass)));
  }

  void clear(PassId pass) override {
    if (pass == PassId::shadow) shadow_ = {}, shadow_read_ = true;
    if (pass == PassId::shade) object_area_ = {};
  }

  ShadowMap shadow_map() override {
    if (!shadow_read_) {
      const Scope scope(*this);
      const Image<float> pixels = read(ratio_, kResolution, kResolution);
      shadow_.ratio = Image<float>(kResolution, kResolution, 3);
      for (std::size_t i = 0; i < shadow_.ratio.data.size(); ++i)
        shadow_.ratio.data[i] = pixels.data[i / 3 * 4 + i % 3];
      shadow_read_ = true;
    }
    return shadow_;
  }

  ObjectLayer object() override {
    ObjectLayer layer;
    if (object_area_.empty()) return layer;
    Image<float> pixels;
    {
      const Scope scope(*this);
      pixels = read(object_, object_area_.width(), object_area_.height());
    }
    int x0 = pixels.width, y0 = pixels.height, x1 = -1, y1 = -1;  // of what is covered
    for (int y = 0; y < pixels.height; ++y)
      for (int x = 0; x < pixels.width; ++x)
        if (pixels.pixel(x, y)[3] > 0)
          x0 = std::min(x0, x), x1 = std::max(x1, x), y0 = std::min(y0, y), y1 = std::max(y1, y);
    if (x1 < 0) return layer;
    layer.x = object_area_.x0 + x0, layer.y = object_area_.y0 + y0;
    layer.rgba = Image<float>(x1 - x0 + 1, y1 - y0 + 1, 4);
    for (int y = y0; y <= y1; ++y)
      std::copy_n(pixels.pixel(x0, y), layer.rgba.width * 4, layer.rgba.row(y - y0));
    return layer;
  }

  Image<std::uint8_t> image() override {
    Image<std::uint8_t> out = bytes_;
    if (area_.empty()) return out;
    Image<std::uint8_t> drawn(area_.width(), area_.height(), 4);
    {
      const Scope scope(*this);
      target(0, picture_);
      glReadPixels(0, 0, drawn.width, drawn.height, GL_RGBA, GL_UNSIGNED_BYTE, drawn.data.data());
    }
    for (int y = 0; y < drawn.height; ++y) {
      const std::uint8_t* from = drawn.row(y);
      std::uint8_t* to = out.pixel(area_.x0, area_.y0 + y);
      if (out.channels == 4) {
        std::copy_n(from, drawn.width * 4, to);
        continue;
      }
      for (int x = 0; x < drawn.width; ++x, from += 4, to += 3)
        to[0] = from[0], to[1] = from[1], to[2] = from[2];
    }
    return out;
  }

  void present(unsigned framebuffer, int width, int height) override {
    const Scope scope(*this);
    if (bytes_.empty()) return;
    const GLenum format = bytes_.channels == 4 ? GL_RGBA : GL_RGB;
    std::vector<std::uint8_t> rgba;
    const std::uint8_t* data = bytes_.data.data();
    if (format == GL_RGB) {  // the texture has four channels, as what is copied into it
      rgba.resize(bytes_.data.size() / 3 * 4, 255);
      for (std::size_t i = 0; i < rgba.size() / 4; ++i) std::copy_n(data + 3 * i, 3, &rgba[4 * i]);
      data = rgba.data();
    }
    allocate(screen_, GL_RGBA8, bytes_.width, bytes_.height, GL_RGBA, GL_UNSIGNED_BYTE, data);
    if (!area_.empty()) {
      target(0, picture_), target(1, screen_);
      glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffers_[0]);
      glBindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffers_[1]);
      glBlitFramebuffer(0, 0, area_.width(), area_.height(), area_.x0, area_.y0, area_.x1, area_.y1,
                        GL_COLOR_BUFFER_BIT, GL_NEAREST);
    }
    target(1, screen_);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffers_[1]);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    glBlitFramebuffer(0, 0, bytes_.width, bytes_.height, 0, height, width, 0, GL_COLOR_BUFFER_BIT,
                      GL_LINEAR);
  }

 private:
  struct Corner {  // of a triangle, as the visibility pass reads it
    glm::vec3 position;
    GLuint triangle;
  };

  // Our context, or the caller's with its state kept.
  class Scope {
   public:
    explicit Scope(const Gl& gl) {
      if (gl.context_)
        current_.emplace(*gl.context_);
      else
        saved_.emplace();
      set_default_state();
    }

   private:
    std::optional<GlContext::Current> current_;
    std::optional<SavedState> saved_;
  };

  static std::string text_of(GLenum what) {
    const GLubyte* text = glGetString(what);
    return text ? reinterpret_cast<const char*>(text) : "";
  }

  // --- textures, targets, programs

  void parameters(GLenum kind, GLenum filter, GLenum reduce) {
    glTexParameteri(kind, GL_TEXTURE_MAG_FILTER, GLint(filter));
    glTexParameteri(kind, GL_TEXTURE_MIN_FILTER, GLint(reduce));
    glTexParameteri(kind, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(kind, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
  }

  // Makes the texture if needed, and fills it if there is data.
  void allocate(Texture& t, GLenum internal, int width, int height, GLenum format, GLenum type,
                const void* data = nullptr) {
    check(width <= largest_ && height <= largest_, "the GL driver's textures have at most ",
          largest_, " texels along an edge, needed ", width, " × ", height);
    glActiveTexture(GL_TEXTURE0);
    if (!t.id) glGenTextures(1, &t.id);
    glBindTexture(GL_TEXTURE_2D, t.id);
    if (t.width != width || t.height != height) {
      glTexImage2D(GL_TEXTURE_2D, 0, GLint(internal), width, height, 0, format, type, data);
      parameters(GL_TEXTURE_2D, GL_NEAREST, GL_NEAREST);
      t.width = width, t.height = height;
    } else if (data) {
      glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, format, type, data);
    }
  }

  // Rows of kRow texels; `values` is padded to whole rows.
  template <typename T>
  void upload_rows(Texture& t, GLenum internal, GLenum format, GLenum type,
                   std::vector<T>& values) {
    const int rows = std::max(1, (int(values.size()) + kRow - 1) / kRow);
    values.resize(std::size_t(rows) * kRow);
    allocate(t, internal, kRow, rows, format, type, values.data());
  }

  void target(int which, const Texture& t, bool depth = false) {
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffers_[which]);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, t.id, 0);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER,
                              depth ? depth_ : 0);
  }

  Image<float> read(const Texture& t, int width, int height) {
    Image<float> out(width, height, 4);
    target(0, t);
    glReadPixels(0, 0, width, height, GL_RGBA, GL_FLOAT, out.data.data());
    return out;
  }

  const Program& use(const std::string& pass, const std::vector<std::string>& defines) {
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

  void bind(const char* sampler, const Texture& t, GLenum kind = GL_TEXTURE_2D) {
    for (const auto& [text, unit] : kUnits)
      if (!std::strcmp(text, sampler)) {
        glActiveTexture(GLenum(GL_TEXTURE0 + unit));
        glBindTexture(kind, t.id);
      }
  }

  void draw_full_screen(int width, int height) {
    glViewport(0, 0, width, height);
    glBindVertexArray(vertex_arrays_[2]);  // empty
    glDrawArrays(GL_TRIANGLES, 0, 3);
  }

  static void set(const Program& p, const char* name, glm::vec3 v) {
    glUniform3f(p.uniform(name), v.x, v.y, v.z);
  }
  static void set(const Program& p, const char* name, const glm::mat3& m) {
    glUniformMatrix3fv(p.uniform(name), 1, GL_FALSE, &m[0][0]);
  }
  static void set_camera(const Program& p, const Camera& c) {
    glUniform4f(p.uniform("intrinsics"), float(c.fx), float(c.fy), float(c.cx), float(c.cy));
    float k[8] = {};
    std::copy(c.distortion.begin(), c.distortion.end(), k);
    glUniform1fv(p.uniform("lens"), 8, k);
  }

  // --- what passes read

  // What stored values are multiplied with, so that the largest one fits half floats.
  static float scale_for(float largest) {
    if (!(largest > 0)) return 1;
    // A scale below this has an inverse that overflows; such light is black on any picture.
    return std::max(std::exp2(std::ceil(std::log2(largest / kHalfMax))), 1e-30f);
  }

  // Level by level as the CPU made them. Half floats are scaled: they end at 65504.
  void upload_radiance(const std::shared_ptr<const CubeMap>& map) {
    check(map && map->size() > 0, "the radiance map is empty");
    if (map == radiance_) return;
    float largest = 0;
    if (half_)
      for (int f = 0; f < 6; ++f)
        for (int y = 0; y < map->size(); ++y)
          for (int x = 0; x < map->size(); ++x) {
            const glm::vec3& t = map->level(0).texel(f, x, y);
            largest = std::max({largest, t.x, t.y, t.z});
          }
    radiance_scale_ = scale_for(largest);
    glActiveTexture(GL_TEXTURE0);
    if (!cube_.id) glGenTextures(1, &cube_.id);
    glBindTexture(GL_TEXTURE_CUBE_MAP, cube_.id);
    std::vector<glm::vec4> texels;
    const float inverse = 1 / radiance_scale_;
    const bool fits = radiance_ && radiance_->size() == map->size();
    for (int k = 0; k < map->level_count(); ++k) {
      const CubeLevel& level = map->level(k);
      const int n = level.size();
      texels.resize(std::size_t(n) * std::size_t(n));
      for (int f = 0; f < 6; ++f) {
        glm::vec4* to = texels.data();
        for (int y = 0; y < n; ++y) {
          const glm::vec3* from = &level.texel(f, 0, y);
          for (int x = 0; x < n; ++x) *to++ = glm::vec4(inverse * from[x], 1);
        }
        const GLenum face = GLenum(GL_TEXTURE_CUBE_MAP_POSITIVE_X + f);
        if (fits)
          glTexSubImage2D(face, k, 0, 0, n, n, GL_RGBA, GL_FLOAT, texels.data());
        else
          glTexImage2D(face, k, half_ ? GL_RGBA16F : GL_RGBA32F, n, n, 0, GL_RGBA, GL_FLOAT,
                       texels.data());
      }
    }
    parameters(GL_TEXTURE_CUBE_MAP, GL_LINEAR, GL_LINEAR_MIPMAP_NEAREST);
    glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAX_LEVEL, map->level_count() - 1);
    radiance_ = map;
  }

  // Any diffuse method as a cube map: what has no shader of its own is one look-up.
  float upload_baked(const Irradiance& irradiance) {
    constexpr int n = kBakedSize;
    std::vector<glm::vec4> texels;
    float largest = 0;
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) {
          const glm::vec3 e = evaluate(irradiance, glm::normalize(texel_direction(f, x, y, n)));
          largest = std::max({largest, e.x, e.y, e.z});
          texels.emplace_back(e, 1);
        }
    const float scale = half_ ? scale_for(largest) : 1.0f;
    for (glm::vec4& t : texels) t /= scale;
    glActiveTexture(GL_TEXTURE0);
    const bool fits = baked_.id;
    if (!fits) glGenTextures(1, &baked_.id);
    glBindTexture(GL_TEXTURE_CUBE_MAP, baked_.id);
    for (int f = 0; f < 6; ++f) {
      const GLenum face = GLenum(GL_TEXTURE_CUBE_MAP_POSITIVE_X + f);
      const glm::vec4* data = &texels[std::size_t(f) * n * n];
      if (fits)
        glTexSubImage2D(face, 0, 0, 0, n, n, GL_RGBA, GL_FLOAT, data);
      else
        glTexImage2D(face, 0, half_ ? GL_RGBA16F : GL_RGBA32F, n, n, 0, GL_RGBA, GL_FLOAT, data);
    }
    parameters(GL_TEXTURE_CUBE_MAP, GL_LINEAR, GL_LINEAR);
    return scale;
  }

  void bind_radiance(const Program& p) {
    bind("radiance", cube_, GL_TEXTURE_CUBE_MAP);
    glUniform1f(p.uniform("radiance_scale"), radiance_scale_);
    glUniform1f(p.uniform("top_level"), float(radiance_->level_count() - 1));
  }

  void upload_mesh(const Scene& scene) {
    if (same_bytes(scene.mesh.vertices, mesh_.vertices) &&
        same_bytes(scene.mesh.triangles, mesh_.triangles) && same_bytes(scene.normals, normal_) &&
        same_bytes(scene.visibility, visibility_))
      return;
    mesh_ = scene.mesh, normal_ = scene.normals, visibility_ = scene.visibility;
    std::vector<glm::vec4> positions, normals;
    for (std::size_t i = 0; i < mesh_.vertices.size(); ++i) {
      positions.emplace_back(mesh_.vertices[i], visibility_[i]);
      normals.emplace_back(normal_[i], 0);
    }
    std::vector<glm::ivec4> triangles;
    std::vector<Corner> corners;
    for (const glm::ivec3& t : mesh_.triangles) {
      triangles.emplace_back(t, 0);
      for (int k = 0; k < 3; ++k)
        corners.push_back({mesh_.vertices[std::size_t(t[k])], GLuint(triangles.size())});
    }
    upload_rows(vertices_, GL_RGBA32F, GL_RGBA, GL_FLOAT, positions);
    upload_rows(normals_, GL_RGBA32F, GL_RGBA, GL_FLOAT, normals);
    upload_rows(triangles_, GL_RGBA32I, GL_RGBA_INTEGER, GL_INT, triangles);
    glBindBuffer(GL_ARRAY_BUFFER, buffers_[0]);
    glBufferData(GL_ARRAY_BUFFER, GLsizeiptr(corners.size() * sizeof(Corner)), corners.data(),
                 GL_STATIC_DRAW);
    corner_count_ = int(corners.size());
  }

  // Only triangles whose corners all lie before the camera and within the lens model.
  int upload_visible_part(const Camera& camera, const Pose& camera_from_object) {
    constexpr double kFarthest = 1 << 21;  // pixels, as the CPU's rasteriser
    const Lens lens(camera);
    std::vector<char> good(mesh_.vertices.size());
    for (std::size_t i = 0; i < good.size(); ++i) {
      const auto pixel = lens.project(camera_from_object * glm::dvec3(mesh_.vertices[i]));
      good[i] = pixel && std::abs(pixel->x) < kFarthest && std::abs(pixel->y) < kFarthest;
    }
    std::vector<Corner> corners;
    for (std::size_t t = 0; t < mesh_.triangles.size(); ++t) {
      const glm::ivec3& index = mesh_.triangles[t];
      if (!good[std::size_t(index[0])] || !good[std::size_t(index[1])] ||
          !good[std::size_t(index[2])])
        continue;
      for (int k = 0; k < 3; ++k)
        corners.push_back({mesh_.vertices[std::size_t(index[k])], GLuint(t + 1)});
    }
    glBindBuffer(GL_ARRAY_BUFFER, buffers_[1]);
    glBufferData(GL_ARRAY_BUFFER, GLsizeiptr(corners.size() * sizeof(Corner)), corners.data(),
                 GL_STREAM_DRAW);
    return int(corners.size());
  }

  void upload_response(const Response& response) {
    if (response_.id && response == response_of_) return;
    response_of_ = response;
    const ByteResponse table(response);
    std::vector<float> rows(512);
    for (int k = 0; k < 256; ++k) {
      rows[std::size_t(k)] = table.decode(std::uint8_t(k));
      rows[256 + std::size_t(k)] = k < 255 ? response.decode((float(k) + 0.5f) / 255.0f) : 2.0f;
    }
    std::vector<glm::vec2> guesses(std::size_t(kGuessRow) * kGuessRow);
    steep_ = false;
    for (std::size_t i = 0; i < guesses.size(); ++i) {
      const float count = float(guesses.size());
      const std::size_t code = table.encode(float(i) / count);
      guesses[i] = glm::vec2(float(code), rows[256 + code]);
      steep_ = steep_ || (code < 255 && rows[256 + code + 1] < float(i + 1) / count);
    }
    allocate(response_, GL_R32F, 256, 2, GL_RED, GL_FLOAT, rows.data());
    allocate(guess_, GL_RG32F, kGuessRow, kGuessRow, GL_RG, GL_FLOAT, guesses.data());
  }

  void upload_rays(const Camera& camera) {
    if (rays_.id && camera == rays_of_) return;
    rays_of_ = camera;
    const RayTable table(camera);
    std::vector<glm::vec2> xy;
    for (std::size_t i = 0; i < table.x.size(); ++i)
      xy.push_back(std::isnan(table.x[i]) ? glm::vec2(1e30f) : glm::vec2(table.x[i], table.y[i]));
    allocate(rays_, GL_RG32F, camera.width, camera.height, GL_RG, GL_FLOAT, xy.data());
  }

  // --- passes

  void shadow(const RenderInput& in) {
    ShadowOptions options;
    options.method = in.methods.shadow;
    const SphereSet spheres = in.scene.placed_spheres();
    const bool caps =
        options.method == ShadowMethod::cap_sum || options.method == ShadowMethod::cap_product;
    // A method without a shader is the CPU's. Of the others this gives place and size: a map of
    // 2 × 2 has border texels only, at which nothing is cast.
    options.resolution = caps ? 2 : kResolution;
    shadow_ = cast_shadow(*in.lighting.radiance, in.lighting.plane_irradiance, spheres, options);
    shadow_read_ = true;
    if (!caps) {
      std::vector<float> rgba;
      for (std::size_t i = 0; i < shadow_.ratio.data.size(); i += 3) {
        rgba.insert(rgba.end(), &shadow_.ratio.data[i], &shadow_.ratio.data[i] + 3);
        rgba.push_back(1);
      }
      allocate(ratio_, GL_RGBA32F, shadow_.ratio.width, shadow_.ratio.height, GL_RGBA, GL_FLOAT,
               rgba.data());
      return;
    }
    upload_radiance(in.lighting.radiance);
    std::vector<glm::vec4> rows[2];
    const double scale = 1.0 / shadow_.extent;
    for (const glm::vec4& s : spheres) {
      const bool usable = std::isfinite(s.x) && std::isfinite(s.y) && std::isfinite(s.z) &&
                          std::isfinite(s.w) && s.w > 0 && s.z + s.w > 0;
      if (!usable || rows[0].size() == std::size_t(largest_)) continue;
      const double z = s.z * scale, r = s.w * scale;
      rows[0].emplace_back((double(s.x) - shadow_.centre.x) * scale,
                           (double(s.y) - shadow_.centre.y) * scale, z, r * r);
      rows[1].emplace_back((z - r) * (z + r), std::max(z, 0.5 * (z + r)), z < r ? 1 : 0, 0);
    }
    const int count = int(rows[0].size());
    if (count > 0) {
      rows[0].insert(rows[0].end(), rows[1].begin(), rows[1].end());
      allocate(spheres_, GL_RGBA32F, count, 2, GL_RGBA, GL_FLOAT, rows[0].data());
    }
    allocate(ratio_, GL_RGBA32F, kResolution, kResolution, GL_RGBA, GL_FLOAT);
    const Program& p =
        use("shadow", {options.method == ShadowMethod::cap_product ? "PRODUCT 1" : "PRODUCT 0"});
    bind_radiance(p);
    bind("spheres", spheres_);
    glm::vec3 inverse(0);
    for (int c = 0; c < 3; ++c)  // as the CPU's: the inverse of a smaller one is not finite
      if (in.lighting.plane_irradiance[c] > 1e-30f)
        inverse[c] = 1 / in.lighting.plane_irradiance[c];
    set(p, "inverse_irradiance", inverse);
    glUniform1f(p.uniform("texels"), kResolution);
    glUniform1f(p.uniform("face_size"), float(radiance_->size()));
    glUniform1i(p.uniform("count"), count);
    target(0, ratio_);
    draw_full_screen(kResolution, kResolution);
    shadow_read_ = false;
  }

  void shade(const RenderInput& in) {
    upload_mesh(in.scene);
    const Camera& camera = in.camera;
    const Pose camera_from_object = in.camera_from_marker * in.scene.marker_from_object;
    const Outline outline = outline_of(mesh_, camera, camera_from_object);
    object_area_ = outline.area;
    if (object_area_.empty()) return;
    const int count =
        outline.whole ? corner_count_ : upload_visible_part(camera, camera_from_object);
    const bool lens = !Lens(camera).trivial();
    const int width = object_area_.width(), height = object_area_.height();
    // Grown in steps, so that a moving object does not make new textures in every frame.
    const auto step = [](int n) { return (n + 63) / 64 * 64; };
    const int quarter_width = std::max(step(width), visible_.width / 2),
              quarter_height = std::max(step(height), visible_.height / 2);

    // Which triangle each sample sees, one quarter of the target a sample.
    if (visible_.width != 2 * quarter_width || visible_.height != 2 * quarter_height) {
      glBindRenderbuffer(GL_RENDERBUFFER, depth_);
      glRenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT24, 2 * quarter_width,
                            2 * quarter_height);
    }
    allocate(visible_, GL_R32UI, 2 * quarter_width, 2 * quarter_height, GL_RED_INTEGER,
             GL_UNSIGNED_INT);
    const glm::mat3 rotation(camera_from_object.rotation);
    const glm::vec3 translation(camera_from_object.translation);
    const auto set_projection = [&](const Program& p) {
      set(p, "camera_from_object", rotation);
      set(p, "camera_from_object_shift", translation);
      set_camera(p, camera);
    };
    const std::string distortion = lens ? "DISTORTION 1" : "DISTORTION 0";
    {
      const Program& p = use("visibility", {distortion});
      set_projection(p);
      glUniform4f(p.uniform("area"), float(object_area_.x0), float(object_area_.y0), float(width),
                  float(height));
      const double n = outline.nearest, f = outline.farthest;
      glUniform2f(p.uniform("depth"), float((f + n) / (f - n)), float(-2 * f * n / (f - n)));
      target(0, visible_, true);
      glEnable(GL_DEPTH_TEST);
      glEnable(GL_SCISSOR_TEST);
      glBindVertexArray(vertex_arrays_[outline.whole ? 0 : 1]);
      const GLuint nothing[4] = {};
      const GLfloat behind = 1;
      for (int s = 0; s < 4; ++s) {
        const int x = s % 2 * quarter_width, y = s / 2 * quarter_height;
        glViewport(x, y, width, height);
        glScissor(x, y, width, height);
        glClearBufferuiv(GL_COLOR, 0, nothing);
        glClearBufferfv(GL_DEPTH, 0, &behind);
        glUniform2f(p.uniform("shift"), 0.5f - float(kSampleX[s]) / 256,
                    0.5f - float(kSampleY[s]) / 256);
        glDrawArrays(GL_TRIANGLES, 0, count);
      }
      glDisable(GL_DEPTH_TEST);
      glDisable(GL_SCISSOR_TEST);
    }

    // Its colour.
    const Material& m = in.scene.material;
    const bool diffuse = lit(m.diffuse), glossy = lit(m.glossy), matte = glossy && m.exponent == 0;
    const bool paper = in.lighting.normalization == Normalization::paper && glossy && !matte;
    const Irradiance& e = in.lighting.irradiance;
    const int variant = diffuse || matte ? (bake_all_ ? kBaked : diffuse_variant(e.method)) : 0;
    allocate(object_, GL_RGBA32F, quarter_width, quarter_height, GL_RGBA, GL_FLOAT);
    const Program& p = use("shade", {"DIFFUSE " + std::to_string(variant),
                                     matte    ? "GLOSSY 2"
                                     : glossy ? "GLOSSY 1"
                                              : "GLOSSY 0",
                                     paper ? "PAPER 1" : "PAPER 0", distortion});
    set_projection(p);
    set(p, "marker_from_object", glm::mat3(in.scene.marker_from_object.rotation));
    set(p, "marker_from_object_shift", glm::vec3(in.scene.marker_from_object.translation));
    set(p, "emission", m.emission);
    set(p, "diffuse_albedo", m.diffuse);
    set(p, "glossy_albedo", m.glossy);
    if (variant == kBaked) {
      glUniform1f(p.uniform("baked_scale"), upload_baked(e));
      bind("baked", baked_, GL_TEXTURE_CUBE_MAP);
    } else if (e.method == DiffuseMethod::sh9) {
      glUniform3fv(p.uniform("light"), 9, &e.polynomial[0].x);
    } else {
      glUniform3fv(p.uniform("light"), 6, &e.faces[0].x);
    }
    if (glossy && !matte) {
      check(in.lighting.glossy == GlossyMethod::mip, "the GL back end has no glossy method ",
            fastibl::name(in.lighting.glossy));
      upload_radiance(in.lighting.radiance);
      glUseProgram(p.id());
      bind_radiance(p);
      set(p, "eye", glm::vec3(in.camera_from_marker.inverse().translation));
      glUniform1f(p.uniform("level"), shared::mip_level(float(radiance_->size()), m.exponent));
    }
    if (paper) {
      if (!albedo_.id)
        allocate(albedo_, GL_R32F, kAlbedoTableSize, kAlbedoTableSize, GL_RED, GL_FLOAT,
                 albedo_table().data());
      bind("albedo_table", albedo_);
      glUniform1f(p.uniform("albedo_row"), shared::albedo_coordinate(m.exponent));
    }
    bind("visible", visible_), bind("triangles", triangles_);
    bind("vertices", vertices_), bind("normals", normals_);
    glUniform2i(p.uniform("quarter"), quarter_width, quarter_height);
    glUniform2i(p.uniform("corner"), object_area_.x0, object_area_.y0);
    target(0, object_);
    draw_full_screen(width, height);
  }

  void composite(const RenderInput& in) {
    const Camera& camera = in.camera;
    const bool matte = in.back.empty();
    bytes_ = matte ? Image<std::uint8_t>(camera.width, camera.height, 4)
                   : bytes_from(in.back, camera.response);
    const Pose marker_from_camera = in.camera_from_marker.inverse();
    const glm::vec3 eye(marker_from_camera.translation);
    Area shadowed;
    if (shadow_.extent > 0 && !shadow_.no_light && eye.z > 0)
      shadowed = outline_of_plane(shadow_.centre, shadow_.extent, camera, in.camera_from_marker);
    area_ = shadowed.united(object_area_);
    if (area_.empty()) return;
    const int width = area_.width(), height = area_.height();
    const bool lens = !Lens(camera).trivial(), rays = lens && !shadowed.empty();
    upload_response(camera.response);
    if (rays) upload_rays(camera);
    if (!matte) {
      std::vector<std::uint8_t> part(std::size_t(width) * std::size_t(height) * 4);
      for (int y = 0; y < height; ++y) {
        const std::uint8_t* from = bytes_.pixel(area_.x0, area_.y0 + y);
        std::uint8_t* to = &part[std::size_t(y) * std::size_t(width) * 4];
        for (int x = 0; x < width; ++x, from += 3, to += 4)
          to[0] = from[0], to[1] = from[1], to[2] = from[2], to[3] = 255;
      }
      fill(back_, width, height, part.data());
    }
    fill(picture_, width, height, nullptr);
    const Program& p = use(
        "composite",
        {matte ? "MATTE 1" : "MATTE 0", object_area_.empty() ? "OBJECT 0" : "OBJECT 1",
         shadowed.empty() ? "SHADOW 0" : "SHADOW 1", rays ? "DISTORTION 1" : "DISTORTION 0",
         "VIGNETTING " + std::to_string(camera.vignetting.size()), steep_ ? "STEEP 1" : "STEEP 0"});
    set_camera(p, camera);
    glUniform2i(p.uniform("corner"), area_.x0, area_.y0);
    glUniform1f(p.uniform("exposure"), float(in.exposure * camera.gain));
    glUniform4i(p.uniform("object_area"), object_area_.x0, object_area_.y0, object_area_.x1,
                object_area_.y1);
    glUniform4f(p.uniform("ratio_place"), shadow_.centre.x, shadow_.centre.y, shadow_.extent, 0);
    set(p, "eye", eye);
    set(p, "marker_from_camera", glm::mat3(marker_from_camera.rotation));
    if (!camera.vignetting.empty()) {
      const std::vector<float> v(camera.vignetting.begin(), camera.vignetting.end());
      glUniform1fv(p.uniform("vignetting"), GLsizei(v.size()), v.data());
    }
    bind("response", response_), bind("guess", guess_);
    if (!matte) bind("back", back_);
    if (!object_area_.empty()) bind("object", object_);
    if (!shadowed.empty()) bind("ratio_map", ratio_);
    if (rays) bind("rays", rays_);
    target(0, picture_);
    draw_full_screen(width, height);
  }

  // An RGBA8 texture that is at least so large; its first pixels from `data`.
  void fill(Texture& t, int width, int height, const std::uint8_t* data) {
    allocate(t, GL_RGBA8, std::max(width, t.width), std::max(height, t.height), GL_RGBA,
             GL_UNSIGNED_BYTE);
    if (data)
      glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, data);
  }

  std::optional<GlContext> context_;  // none: the caller's
  std::string device_;
  bool half_ = false, bake_all_ = false, steep_ = false;
  int largest_ = 2048;
  GLuint framebuffers_[2] = {}, vertex_arrays_[3] = {}, buffers_[2] = {}, depth_ = 0;
  std::map<std::string, Program> programs_;
  Texture cube_, baked_, ratio_, spheres_, visible_, triangles_, vertices_, normals_, albedo_,
      object_, back_, picture_, screen_, response_, guess_, rays_;

  std::shared_ptr<const CubeMap>
      radiance_;  // that is in cube_; kept alive, so its address is its own
  float radiance_scale_ = 1;
  Mesh mesh_;  // that is in the buffers
  std::vector<glm::vec3> normal_;
  std::vector<float> visibility_;
  int corner_count_ = 0;
  Response response_of_;
  Camera rays_of_;

  ShadowMap shadow_;  // its ratio is read back on request
  bool shadow_read_ = true;
  Area object_area_, area_;    // drawn: of the object, and of the image
  Image<std::uint8_t> bytes_;  // the image outside `area_`
};

}  // namespace

std::unique_ptr<GlRenderer> make_gl_renderer() { return std::make_unique<Gl>(true); }
std::unique_ptr<GlRenderer> make_gl_renderer(CurrentContext) { return std::make_unique<Gl>(false); }

}  // namespace fastibl
