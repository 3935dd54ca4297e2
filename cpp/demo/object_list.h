// Objects to choose from.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl::demo {

class ObjectList {
 public:
  // files: after the built-in ones; z_up: of all files.
  ObjectList(const std::vector<std::filesystem::path>& files, bool z_up);

  const std::vector<std::string>& names() const { return names_; }
  // Of a name, or of an OBJ file. In its own frame, as it came. Throws std::invalid_argument for
  // neither.
  Mesh mesh(const std::string& name) const;
  void add(const std::string& name);  // to the list, where it is not there

 private:
  std::vector<std::string> names_;
  bool z_up_;
};

}  // namespace fastibl::demo
