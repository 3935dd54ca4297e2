#include "fastibl/scene/room_box.h"

#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {

void check_box(const RoomBox& box, const glm::dvec3& centre) {
  for (int k = 0; k < 3; ++k)
    check(box.lower[k] < centre[k] && centre[k] < box.upper[k] && std::isfinite(box.lower[k]) &&
              std::isfinite(box.upper[k]),
          "the room's box must be finite and hold the centre, got ", box.lower[k], " to ",
          box.upper[k], " along axis ", k, " around ", centre[k]);
}

}  // namespace fastibl
