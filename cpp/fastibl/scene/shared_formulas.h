// The formulas that C++ and the shaders share, compiled as C++: one source, so the two agree. To be
// included by .cpp files only (the shaders folder is not installed).
#pragma once

#include "fastibl/core/vector.h"

#define FN inline
namespace fastibl::shared {
using namespace glm;
#include "shaders/shared/sphere_cap.glsl"
}  // namespace fastibl::shared
#undef FN
