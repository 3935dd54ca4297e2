// Shader texts, and programs made of them.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

// Name below shaders/ to text. Generated from the files.
const std::map<std::string, std::string>& embedded_shaders();

// Text of one shader with its #include "shared/x.glsl" lines replaced and one #define line a
// define ("GLOSSY 1") after the version. The environment variable FASTIBL_SHADERS names a folder
// that is read instead of the embedded texts.
std::string shader_source(const std::string& name, const std::vector<std::string>& defines);

// A linked program, to be made and used in a current context. Throws std::runtime_error with the
// driver's log.
class Program {
 public:
  Program(const std::string& vertex, const std::string& fragment,
          const std::vector<std::string>& defines);
  unsigned id() const { return id_; }
  int uniform(const char* name) const;  // location; −1 where the variant has none

 private:
  unsigned id_ = 0;
  std::map<std::string, int> locations_;
};

// Of the program in use.
void set(const Program& p, const char* name, glm::vec3 v);
void set(const Program& p, const char* name, const glm::mat3& m);
void set_camera(const Program& p, const Camera& c);

}  // namespace fastibl
