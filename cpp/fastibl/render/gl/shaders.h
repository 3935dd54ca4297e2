// Shader texts, and the programs made from them.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

// Maps a name below shaders/ to its text. Generated from the files.
const std::map<std::string, std::string>& embedded_shaders();

// The text of one shader with its #include "shared/x.glsl" lines replaced, and one #define line for
// each define ("GLOSSY 1") after the version. The environment variable FASTIBL_SHADERS names a
// folder that is read instead of the embedded texts.
std::string shader_source(const std::string& name, const std::vector<std::string>& defines);

// A linked program, to be made and used in a current context. Throws std::runtime_error with the
// log of the driver.
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

// For the program in use.
void set(const Program& p, const char* name, glm::vec3 v);
void set(const Program& p, const char* name, const glm::mat3& m);
// The variant, and the uniforms, of shared/projection.glsl.
std::string distortion(const Camera& camera);
void set_projection(const Program& p, const Camera& camera, const Pose& camera_from_mesh);
void set_camera(const Program& p, const Camera& c);

}  // namespace fastibl
