#include "fastibl/render/gl/shaders.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace fastibl {
namespace {

std::string text_of(const std::string& name) {
  if (const char* folder = std::getenv("FASTIBL_SHADERS")) {
    std::ifstream file(std::string(folder) + "/" + name);
    if (!file) throw std::runtime_error("FASTIBL_SHADERS: no " + name + " in " + folder);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  const auto found = embedded_shaders().find(name);
  if (found == embedded_shaders().end()) throw std::runtime_error("no shader " + name);
  return found->second;
}

std::string expand(const std::string& name) {
  std::istringstream in(text_of(name));
  std::string line, out;
  while (std::getline(in, line)) {
    const std::string start = "#include \"";
    if (line.rfind(start, 0) == 0)
      out += expand(line.substr(start.size(), line.find('"', start.size()) - start.size()));
    else
      out += line + "\n";
  }
  return out;
}

GLuint compile(GLenum kind, const std::string& name, const std::vector<std::string>& defines) {
  const std::string source = shader_source(name, defines);
  const char* text = source.c_str();
  const GLuint shader = glCreateShader(kind);
  glShaderSource(shader, 1, &text, nullptr);
  glCompileShader(shader);
  GLint good = 0;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
  if (good) return shader;
  char log[4096] = "";
  glGetShaderInfoLog(shader, sizeof log, nullptr, log);
  glDeleteShader(shader);
  std::string variant;
  for (const std::string& define : defines) variant += " " + define;
  throw std::runtime_error(name + " does not compile as" + variant + ":\n" + log);
}

}  // namespace

std::string shader_source(const std::string& name, const std::vector<std::string>& defines) {
  std::string text = expand(name), lines;
  for (const std::string& define : defines) lines += "#define " + define + "\n";
  text.insert(text.find('\n') + 1, lines);
  return text;
}

Program::Program(const std::string& vertex, const std::string& fragment,
                 const std::vector<std::string>& defines) {
  const GLuint v = compile(GL_VERTEX_SHADER, vertex, defines);
  GLuint f = 0;
  try {
    f = compile(GL_FRAGMENT_SHADER, fragment, defines);
  } catch (...) {
    glDeleteShader(v);
    throw;
  }
  id_ = glCreateProgram();
  glAttachShader(id_, v), glAttachShader(id_, f);
  glLinkProgram(id_);
  glDeleteShader(v), glDeleteShader(f);
  GLint good = 0, count = 0;
  glGetProgramiv(id_, GL_LINK_STATUS, &good);
  if (!good) {
    char log[4096] = "";
    glGetProgramInfoLog(id_, sizeof log, nullptr, log);
    glDeleteProgram(id_);
    throw std::runtime_error(fragment + " does not link:\n" + log);
  }
  glGetProgramiv(id_, GL_ACTIVE_UNIFORMS, &count);
  for (GLint i = 0; i < count; ++i) {
    char name[128];
    GLint size;
    GLenum type;
    glGetActiveUniform(id_, GLuint(i), sizeof name, nullptr, &size, &type, name);
    const std::string plain = std::string(name).substr(0, std::string(name).find('['));
    locations_[plain] = glGetUniformLocation(id_, name);
  }
}

int Program::uniform(const char* name) const {
  const auto found = locations_.find(name);
  return found == locations_.end() ? -1 : found->second;
}

void set(const Program& p, const char* name, glm::vec3 v) {
  glUniform3f(p.uniform(name), v.x, v.y, v.z);
}

void set(const Program& p, const char* name, const glm::mat3& m) {
  glUniformMatrix3fv(p.uniform(name), 1, GL_FALSE, &m[0][0]);
}

std::string distortion(const Camera& camera) {
  return Lens(camera).trivial() ? "DISTORTION 0" : "DISTORTION 1";
}

void set_projection(const Program& p, const Camera& camera, const Pose& camera_from_mesh) {
  set(p, "camera_from_object", glm::mat3(camera_from_mesh.rotation));
  set(p, "camera_from_object_shift", glm::vec3(camera_from_mesh.translation));
  set_camera(p, camera);
}

void set_camera(const Program& p, const Camera& c) {
  glUniform4f(p.uniform("intrinsics"), float(c.fx), float(c.fy), float(c.cx), float(c.cy));
  float k[8] = {};
  std::copy(c.distortion.begin(), c.distortion.end(), k);
  glUniform1fv(p.uniform("lens"), 8, k);
}

}  // namespace fastibl
