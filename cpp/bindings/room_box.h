// Corners of a room as Python gives them.
#pragma once

#include <array>
#include <optional>

#include "fastibl/scene/room_box.h"

namespace fastibl::bindings {

inline std::optional<RoomBox> room_box(
    const std::optional<std::array<std::array<double, 3>, 2>>& corners) {
  if (!corners) return std::nullopt;
  const auto& [lower, upper] = *corners;
  return RoomBox{{lower[0], lower[1], lower[2]}, {upper[0], upper[1], upper[2]}};
}

}  // namespace fastibl::bindings
