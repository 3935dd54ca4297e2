// The vector types of every public interface: GLM's, float for pictures and light, double for
// poses.
#pragma once

#include <glm/glm.hpp>
#include <numbers>

namespace fastibl {

inline constexpr float kPi = std::numbers::pi_v<float>;

}  // namespace fastibl
