// Where the things are that a map shows.
#pragma once

#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

// What a map shows above the horizon: a sphere around the map's centre, or the walls of a room.
// Elsewhere than in the centre it is seen in other directions.
class MapSurface {
 public:
  MapSurface() = default;  // infinitely far
  // distance: metres from the centre, may be infinite; a box, if there is one, takes precedence.
  MapSurface(const glm::dvec3& centre, double distance, const std::optional<RoomBox>& box);

  // 1 / metres from the centre, in a direction of the map, times the direction's length.
  double nearness(const glm::dvec3& direction) const;
  // The direction, not of unit length, in which an eye sees what the map shows in a direction.
  glm::dvec3 seen_from(const glm::dvec3& eye, const glm::dvec3& direction) const {
    return direction - nearness(direction) * (eye - centre_);
  }
  // The direction in which the map shows what an eye sees along a ray; both of unit length.
  glm::dvec3 recorded(const glm::dvec3& eye, const glm::dvec3& ray) const;

  const glm::dvec3& centre() const { return centre_; }
  bool is_near() const { return box_ || inverse_distance_ > 0; }  // nearer than infinity
  double distance() const { return 1 / inverse_distance_; }  // of the sphere, also beside a box
  const std::optional<RoomBox>& box() const { return box_; }
  // 1 / distance of the walls along the walls' own axes: of the upper and of the lower walls.
  const glm::dvec3* walls() const { return walls_; }
  const glm::dvec2& walls_axis() const { return axis_; }  // cosine and sine of their yaw
  bool operator==(const MapSurface&) const = default;

 private:
  glm::dvec3 centre_{0};
  double inverse_distance_ = 0;
  std::optional<RoomBox> box_;
  glm::dvec3 walls_[2] = {glm::dvec3(0), glm::dvec3(0)};
  glm::dvec2 axis_{1, 0};
};

}  // namespace fastibl
