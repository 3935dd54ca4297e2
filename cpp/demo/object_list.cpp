#include "demo/object_list.h"

#include <algorithm>
#include <cctype>

#include "demo/object.h"
#include "fastibl/core/check.h"

namespace fastibl::demo {

ObjectList::ObjectList(const std::vector<std::filesystem::path>& files, bool z_up)
    : names_{"knot", "ball", "steps"}, z_up_(z_up) {
  for (const std::filesystem::path& file : files) add(file.string());
}

void ObjectList::add(const std::string& name) {
  if (std::find(names_.begin(), names_.end(), name) == names_.end()) names_.push_back(name);
}

Mesh ObjectList::mesh(const std::string& name) const {
  if (name == "knot") return knot();
  if (name == "ball") return ball();
  if (name == "steps") return steps();
  std::string ending = std::filesystem::path(name).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return char(std::tolower(c)); });
  check(ending == ".obj",
        "expected a .obj file or one of knot, "
        "ball, steps; got \"",
        name, '"');
  return read_object(name, z_up_);
}

}  // namespace fastibl::demo
