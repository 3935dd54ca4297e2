// A room as Python gives it.
#pragma once

#include <array>
#include <optional>
#include <stdexcept>

#include "bindings/numpy.h"
#include "fastibl/scene/room_box.h"

namespace fastibl::bindings {

using RoomCorners = std::array<std::array<double, 3>, 2>;

inline std::optional<RoomBox> room_box(const std::optional<RoomCorners>& corners, double yaw) {
  if (!corners && yaw != 0)
    throw std::invalid_argument("box_yaw turns a box, and no box was given");
  if (!corners) return std::nullopt;
  const auto& [lower, upper] = *corners;
  return RoomBox{{lower[0], lower[1], lower[2]}, {upper[0], upper[1], upper[2]}, yaw};
}

// Corners (2, 3), None for no box.
inline std::optional<Doubles> corners(const std::optional<RoomBox>& box) {
  if (!box) return std::nullopt;
  Doubles out({2, 3});
  for (int k = 0; k < 3; ++k)
    out.mutable_at(0, k) = box->lower[k], out.mutable_at(1, k) = box->upper[k];
  return out;
}

inline double yaw_of(const std::optional<RoomBox>& box) { return box ? box->yaw : 0; }

}  // namespace fastibl::bindings
