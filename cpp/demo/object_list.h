// The objects to choose from.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "fastibl/scene/mesh.h"

namespace fastibl::demo {

class ObjectList {
 public:
  // files: listed after the built-in objects. z_up: applies to all files.
  ObjectList(const std::vector<std::filesystem::path>& files, bool z_up);

  const std::vector<std::string>& names() const { return names_; }
  // The mesh of a built-in name, or of an OBJ file, in its own frame and unchanged. Throws
  // std::invalid_argument for anything else.
  Mesh mesh(const std::string& name) const;
  void add(const std::string& name);  // to the list, unless it is there

 private:
  std::vector<std::string> names_;
  bool z_up_;
};

}  // namespace fastibl::demo
