// The formulas of shaders/shared, compiled for C++ through GLM. For .cpp files: the path is
// private.
#pragma once

#include "fastibl/core/simd.h"
#include "fastibl/core/vector.h"

#define FN FASTIBL_INLINE
#define REAL double
#define REAL2 dvec2
#define REAL3 dvec3
namespace fastibl::shared {
using namespace glm;
#include "shaders/shared/ggx_light.glsl"
#include "shaders/shared/ggx.glsl"
#include "shaders/shared/glossy.glsl"
#include "shaders/shared/lens.glsl"
#include "shaders/shared/lighting.glsl"
#include "shaders/shared/material.glsl"
#include "shaders/shared/plane.glsl"
#include "shaders/shared/sphere_cap.glsl"
#include "shaders/shared/near_light.glsl"
#include "shaders/shared/placed_light.glsl"
}  // namespace fastibl::shared
#undef FN
#undef REAL
#undef REAL2
#undef REAL3
