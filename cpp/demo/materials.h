// Materials to choose from.
#pragma once

#include <string>
#include <vector>

#include "fastibl/scene/material.h"

namespace fastibl::demo {

// "given", for the material that the arguments describe, and the built-in ones.
std::vector<std::string> material_names();
// Throws std::invalid_argument for any other name.
Material material_named(const std::string& name, const Material& given);

}  // namespace fastibl::demo
