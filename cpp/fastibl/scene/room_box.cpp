#include "fastibl/scene/room_box.h"

#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {

glm::dvec2 RoomBox::axis() const { return {std::cos(yaw), std::sin(yaw)}; }

void check_box(const RoomBox& box, const glm::dvec3& centre) {
  check(std::isfinite(box.yaw), "the yaw of the room's box must be finite, got ", box.yaw);
  const glm::dvec3 at = along_walls(centre, box.axis());
  for (int k = 0; k < 3; ++k)
    check(box.lower[k] < at[k] && at[k] < box.upper[k] && std::isfinite(box.lower[k]) &&
              std::isfinite(box.upper[k]),
          "the room's box must be finite and hold the centre, got ", box.lower[k], " to ",
          box.upper[k], " along axis ", k, " around ", at[k]);
}

RoomBox turned(const RoomBox& box, const glm::dmat3& new_from_old) {
  RoomBox out = box;
  out.yaw += std::atan2(new_from_old[0][1], new_from_old[0][0]);
  return out;
}

WallsAround::WallsAround(const RoomBox& box, const glm::dvec3& centre) : axis(box.axis()) {
  const glm::dvec3 at = along_walls(centre, box.axis());
  lower = box.lower - at, upper = box.upper - at;
}

glm::vec3 WallsAround::direction(glm::vec3 d, glm::vec3 offset) const {
  return shared::box_direction(d, offset, lower, upper, axis);
}

}  // namespace fastibl
