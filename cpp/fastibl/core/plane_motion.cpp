#include "fastibl/core/plane_motion.h"

#include <cmath>

namespace fastibl {

std::optional<PlaneMotion> motion_along_plane(const Pose& motion, glm::vec2 middle, float size) {
  const glm::dvec3 up = motion.rotation[2], shift = motion.translation;
  if (!(std::hypot(up.x, up.y) <= kStandingSlack && up.z > 0)) return std::nullopt;
  // A turn within the slack lifts what is far from the origin.
  const double lift = (motion * glm::dvec3(glm::dvec2(middle), 0)).z;
  if (!(std::fabs(lift) <= kStandingSlack * double(size))) return std::nullopt;
  const glm::dvec2 along(motion.rotation[0]);
  PlaneMotion found{glm::vec2(shift), glm::vec2(along / glm::length(along))};
  // Rounding may leave this much of no turn at all.
  if (std::fabs(found.cos_sin.y) < 1e-6f && found.cos_sin.x > 0) found.cos_sin = {1, 0};
  return found;
}

}  // namespace fastibl
