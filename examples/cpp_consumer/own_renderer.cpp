// Your own renderer, in your own GL context, which takes the light and the shadow from fastibl as
// textures: a cube of irradiance, prefiltered levels by roughness, and a shadow map of the plane.
// Here it is one shader that traces a ball on a table.
#include <epoxy/egl.h>
#include <epoxy/gl.h>
#include <fastibl/lighting/fit_lighting.h>
#include <fastibl/lighting/prefilter.h>
#include <fastibl/shadow/sphere_shadow.h>

#include <string>

#include "ppm.h"
#include "stage.h"

using namespace fastibl;

static const char* kVertex = R"(#version 300 es
void main() {  // one triangle over the picture
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
})";

static const char* kFragment = R"(#version 300 es
precision highp float;
uniform samplerCube irradiance, prefiltered;  // looked up with directions of the marker frame
uniform sampler2D shadow;
uniform vec2 shadow_centre;
uniform float shadow_extent, top_level;
uniform mat3 marker_from_camera;
uniform vec3 eye, focal;  // focal: f, and the principal point, pixels
const vec4 ball = vec4(0.0, 0.0, 0.05, 0.05);
const float roughness = 0.4, pi = 3.14159265;
out vec4 colour;

vec3 on_ball(vec3 n, vec3 d) {
  float f = 0.04 + 0.96 * pow(1.0 - max(dot(n, -d), 0.0), 5.0);
  return 0.7 * texture(irradiance, n).rgb / pi + f * textureLod(prefiltered, reflect(d, n), roughness * top_level).rgb;
}
vec3 on_table(vec2 p) {
  vec2 uv = (p - shadow_centre) / (2.0 * shadow_extent) + 0.5;
  bool inside = all(equal(uv, clamp(uv, 0.0, 1.0)));
  vec3 ratio = inside ? textureLod(shadow, uv, 0.0).rgb : vec3(1.0);
  return 0.5 * ratio * texture(irradiance, vec3(0.0, 0.0, 1.0)).rgb / pi;
}
void main() {  // row 0 of the picture is its top
  vec3 d = normalize(marker_from_camera * vec3((gl_FragCoord.xy - focal.yz) / focal.x, 1.0));
  vec3 c = eye - ball.xyz;
  float b = dot(c, d), h = b * b - dot(c, c) + ball.w * ball.w;
  vec3 radiance = h > 0.0 ? on_ball((c + d * (-b - sqrt(h))) / ball.w, d) : on_table((eye - d * eye.z / d.z).xy);
  colour = vec4(pow(min(radiance, 1.0), vec3(1.0 / 2.2)), 1.0);
})";

static void need(bool holds, const char* what) {
  if (!holds) throw std::runtime_error(what);
}

static void make_context() {
  const EGLDisplay display =
      eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
  need(eglInitialize(display, nullptr, nullptr), "no EGL display without a surface");
  eglBindAPI(EGL_OPENGL_ES_API);
  const EGLint version[] = {EGL_CONTEXT_CLIENT_VERSION, 3, EGL_NONE};
  const EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, version);
  need(context != EGL_NO_CONTEXT, "no OpenGL ES 3.0");
  need(eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context), "no current context");
}

static GLuint shader(GLenum type, const char* text) {
  const GLuint id = glCreateShader(type);
  glShaderSource(id, 1, &text, nullptr);
  glCompileShader(id);
  GLint done = 0;
  glGetShaderiv(id, GL_COMPILE_STATUS, &done);
  need(done, "a shader does not compile");
  return id;
}

static void filtered(GLenum target, GLint min_filter) {
  glTexParameteri(target, GL_TEXTURE_MIN_FILTER, min_filter);
  glTexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  glTexParameteri(target, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTexParameteri(target, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}

// Uploads a level of a cube texture. Its faces, rows and axes are those of OpenGL; its rows have a
// border to step over.
static void upload(const CubeLevel& level, GLint mip) {
  glPixelStorei(GL_UNPACK_ROW_LENGTH, GLint(level.row_stride()));
  for (int f = 0; f < 6; ++f)
    glTexImage2D(GL_TEXTURE_CUBE_MAP_POSITIVE_X + GLenum(f), mip, GL_RGB16F, level.size(),
                 level.size(), 0, GL_RGB, GL_FLOAT, level.face(f));
  glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);
}

int main(int argc, char** argv) try {
  // The light. A captured map would come from Capture::environment() or Session.
  const auto map = std::make_shared<const CubeMap>(sky({1, 0, 0.5f}));
  LightingOptions options;
  options.diffuse = DiffuseMethod::irradiance_cube;
  const Lighting lighting = fit_lighting(map, options);
  std::vector<PrefilterLevel> levels;
  for (const double alpha : level_parameters(LevelMapping::gltf, 5))
    levels.push_back({alpha, 64 >> levels.size()});
  const std::vector<CubeMap> chain = prefilter(map, levels);
  ShadowOptions one_map;
  one_map.outer = false;
  const ShadowMap shadow =
      cast_shadow(*map, lighting.plane_irradiance, {{0, 0, 0.05f, 0.05f}}, one_map);

  // The light and the shadow as textures.
  make_context();
  GLuint textures[3];
  glGenTextures(3, textures);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_CUBE_MAP, textures[0]);
  upload(*lighting.irradiance.cube, 0);
  filtered(GL_TEXTURE_CUBE_MAP, GL_LINEAR);
  glActiveTexture(GL_TEXTURE1);
  glBindTexture(GL_TEXTURE_CUBE_MAP, textures[1]);
  for (std::size_t k = 0; k < chain.size(); ++k) upload(chain[k].level(0), GLint(k));
  glTexParameteri(GL_TEXTURE_CUBE_MAP, GL_TEXTURE_MAX_LEVEL, GLint(chain.size()) - 1);
  filtered(GL_TEXTURE_CUBE_MAP, GL_LINEAR_MIPMAP_LINEAR);
  glActiveTexture(GL_TEXTURE2);
  glBindTexture(GL_TEXTURE_2D, textures[2]);
  glTexImage2D(GL_TEXTURE_2D, 0, GL_RGB16F, shadow.ratio.width, shadow.ratio.height, 0, GL_RGB,
               GL_FLOAT, shadow.ratio.data.data());  // row 0 is y min
  filtered(GL_TEXTURE_2D, GL_LINEAR);

  // Your own renderer.
  const Camera view = camera();
  const Pose marker_from_camera = back_from_marker().inverse();
  const GLuint program = glCreateProgram();
  glAttachShader(program, shader(GL_VERTEX_SHADER, kVertex));
  glAttachShader(program, shader(GL_FRAGMENT_SHADER, kFragment));
  glLinkProgram(program);
  glUseProgram(program);
  const auto at = [&](const char* name) { return glGetUniformLocation(program, name); };
  const glm::mat3 rotation(marker_from_camera.rotation);
  const glm::vec3 eye(marker_from_camera.translation);
  glUniform1i(at("irradiance"), 0);
  glUniform1i(at("prefiltered"), 1);
  glUniform1i(at("shadow"), 2);
  glUniform2f(at("shadow_centre"), shadow.centre.x, shadow.centre.y);
  glUniform1f(at("shadow_extent"), shadow.extent);
  glUniform1f(at("top_level"), float(chain.size() - 1));
  glUniformMatrix3fv(at("marker_from_camera"), 1, GL_FALSE, &rotation[0].x);
  glUniform3fv(at("eye"), 1, &eye.x);
  glUniform3f(at("focal"), float(view.fx), float(view.cx), float(view.cy));

  GLuint target, framebuffer, none;
  glGenRenderbuffers(1, &target);
  glBindRenderbuffer(GL_RENDERBUFFER, target);
  glRenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, view.width, view.height);
  glGenFramebuffers(1, &framebuffer);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, target);
  glGenVertexArrays(1, &none);
  glBindVertexArray(none);
  glViewport(0, 0, view.width, view.height);
  glDrawArrays(GL_TRIANGLES, 0, 3);
  Image<std::uint8_t> image(view.width, view.height, 4);
  glReadPixels(0, 0, view.width, view.height, GL_RGBA, GL_UNSIGNED_BYTE, image.data.data());
  need(glGetError() == GL_NO_ERROR, "an error of OpenGL");
  write_ppm(argc > 1 ? argv[1] : "own_renderer.ppm", image);
  const glm::vec3 e = lighting.plane_irradiance;
  std::printf("irradiance of the plane %.4f %.4f %.4f, drawn by %s\n", e.r, e.g, e.b,
              reinterpret_cast<const char*>(glGetString(GL_RENDERER)));
} catch (const std::exception& error) {
  std::fprintf(stderr, "own_renderer: %s\n", error.what());
  return 1;
}
