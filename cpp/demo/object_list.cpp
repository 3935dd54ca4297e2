#include "demo/object_list.h"

#include <algorithm>

#include "demo/object.h"
#include "fastibl/core/check.h"

namespace fastibl::demo {

ObjectList::ObjectList(const std::vector<std::filesystem::path>& files, bool z_up)
    : names_{"knot", "ball", "steps"}, z_up_(z_up) {
  for (const std::filesystem::path& file : files)
    if (std::find(names_.begin(), names_.end(), file.string()) == names_.end())
      names_.push_back(file.string());
}

Mesh ObjectList::mesh(const std::string& name) {
  if (name == "knot") return knot();
  if (name == "ball") return ball();
  if (name == "steps") return steps();
  check(std::filesystem::path(name).extension() == ".obj",
        "expected a .obj file or one of knot, "
        "ball, steps; got \"",
        name, '"');
  Mesh mesh = read_object(name, z_up_);
  if (std::find(names_.begin(), names_.end(), name) == names_.end()) names_.push_back(name);
  return mesh;
}

}  // namespace fastibl::demo
