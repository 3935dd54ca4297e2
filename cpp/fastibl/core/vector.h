// The vector types of every public interface are GLM's: float for pictures and light, double for
// poses. All other headers include GLM through this one.
#pragma once

#if __cplusplus < 202002L
#error "fastibl needs C++20"
#endif

#include <glm/glm.hpp>
#include <numbers>
#include <type_traits>

namespace fastibl {

inline constexpr float kPi = std::numbers::pi_v<float>;
inline constexpr double kDegree = std::numbers::pi / 180;  // radians

// The library is compiled with GLM's defaults. Macros that change the size, the alignment or the
// precision of vectors, or how functions take them, would make its users read memory in another way
// than it was written. They are refused here, before the program crashes.
static_assert(sizeof(glm::vec3) == 12 && alignof(glm::vec3) == 4 && alignof(glm::vec4) == 4 &&
                  sizeof(glm::dvec3) == 24 && alignof(glm::dvec3) == 8 &&
                  sizeof(glm::dmat3) == 72 && alignof(glm::dmat4) == 8,
              "fastibl needs GLM's packed vectors: without GLM_FORCE_DEFAULT_ALIGNED_GENTYPES or "
              "GLM_FORCE_ALIGNED_GENTYPES in code that includes its headers");
static_assert(std::is_same_v<glm::vec3, glm::vec<3, float, glm::packed_highp>> &&
                  std::is_same_v<glm::dvec3, glm::vec<3, double, glm::packed_highp>> &&
                  std::is_same_v<glm::ivec3, glm::vec<3, int, glm::packed_highp>>,
              "fastibl needs GLM's default precision: without GLM_FORCE_PRECISION_… macros in code "
              "that includes its headers");
static_assert(std::is_trivially_copyable_v<glm::vec3> && std::is_trivially_copyable_v<glm::dmat3>,
              "fastibl needs GLM's trivially copied vectors: without GLM_FORCE_CTOR_INIT or "
              "GLM_FORCE_CXX98 in code that includes its headers");

}  // namespace fastibl
