// How an object that stands on the plane z = 0 was moved along it: a turn about z and a shift.
#pragma once

#include <optional>

#include "fastibl/core/pose.h"
#include "fastibl/core/vector.h"

namespace fastibl {

struct PlaneMotion {
  glm::vec2 shift{0};
  glm::vec2 cos_sin{1, 0};  // of the turn

  bool turned() const { return cos_sin != glm::vec2(1, 0); }
  glm::vec2 operator*(glm::vec2 p) const {
    return shift + glm::vec2(cos_sin.x * p.x - cos_sin.y * p.y, cos_sin.y * p.x + cos_sin.x * p.y);
  }
  PlaneMotion turn() const { return {{0, 0}, cos_sin}; }  // without the shift
  PlaneMotion inverse() const {
    PlaneMotion back{{0, 0}, {cos_sin.x, -cos_sin.y}};
    back.shift = -(back * shift);
    return back;
  }
  bool operator==(const PlaneMotion&) const = default;
};

// The motion of an object of this size (metres) that stood around `middle`; std::nullopt if it was
// tilted by more than kStandingSlack radians, or lifted by more than that times its size.
inline constexpr double kStandingSlack = 1e-3;
std::optional<PlaneMotion> motion_along_plane(const Pose& motion, glm::vec2 middle, float size);

}  // namespace fastibl
