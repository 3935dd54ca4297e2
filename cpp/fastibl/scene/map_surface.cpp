#include "fastibl/scene/map_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastibl {

MapSurface::MapSurface(const glm::dvec3& centre, double distance, const std::optional<RoomBox>& box)
    : centre_(centre), inverse_distance_(1 / distance), box_(box) {
  if (!box) return;
  axis_ = box->axis();
  const glm::dvec3 at = along_walls(centre, axis_);
  walls_[0] = 1.0 / (box->upper - at), walls_[1] = 1.0 / (box->lower - at);
}

double MapSurface::nearness(const glm::dvec3& direction) const {
  if (!box_) return inverse_distance_ > 0 ? inverse_distance_ * glm::length(direction) : 0;
  const glm::dvec3 d = along_walls(direction, axis_);
  const glm::dvec3 most = glm::max(d * walls_[0], d * walls_[1]);
  return std::max(most.x, std::max(most.y, most.z));
}

glm::dvec3 MapSurface::recorded(const glm::dvec3& eye, const glm::dvec3& ray) const {
  const glm::dvec3 offset = eye - centre_;
  double along = std::numeric_limits<double>::infinity();
  if (box_) {
    const glm::dvec3 d = along_walls(ray, axis_), from = along_walls(offset, axis_);
    for (int axis = 0; axis < 3; ++axis) {
      const double wall = 1.0 / walls_[d[axis] < 0 ? 1 : 0][axis];
      if (d[axis] != 0) along = std::min(along, std::max(0.0, (wall - from[axis]) / d[axis]));
    }
  } else if (inverse_distance_ > 0) {
    const double distance = 1.0 / inverse_distance_;
    const double half = glm::dot(offset, ray);
    const double square = half * half + distance * distance - glm::dot(offset, offset);
    if (square > 0) along = std::sqrt(square) - half;
  }
  if (!(along > 0 && std::isfinite(along))) return ray;
  return glm::normalize(offset + along * ray);
}

}  // namespace fastibl
