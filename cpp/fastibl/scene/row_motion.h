// How a camera moves while a rolling shutter reads its picture.
#pragma once

#include "fastibl/core/pose.h"

namespace fastibl {

// A point at x in the camera frame of one row is at exp([u]×)(x + z) in that of a row that is read
// a share s of the readout later, with u = s turn + s² turning / 2 and
// z = s shift + s² shifting / 2.
struct RowMotion {
  glm::dvec3 turn{0};   // radians a readout, in the camera frame
  glm::dvec3 shift{0};  // metres a readout, of the place against the camera: minus the camera's own
  glm::dvec3 turning{0}, shifting{0};  // accelerations: by how much the two grow in a readout

  glm::dvec3 moved(const glm::dvec3& point, double share) const;
  Pose moved(const Pose& camera_from_marker, double share) const;
  // The velocity, per readout, of a point that is seen at `point` at that share.
  glm::dvec3 speed(const glm::dvec3& point, double share) const;
  // The same motion, expressed in the camera frame of a row that is `share` later.
  RowMotion seen_from(double share) const;
  bool operator==(const RowMotion&) const = default;
};

// A steady motion from the first row's pose to the last row's, along the same path as capture's
// RowPoses.
RowMotion motion_between(const Pose& first, const Pose& last);

// exp([w]×) x by its series up to the third power: for a turn of 0.1 radians the error is 4e-6 |x|.
inline glm::dvec3 slightly_turned(const glm::dvec3& w, const glm::dvec3& x) {
  const glm::dvec3 a = glm::cross(w, x), b = glm::cross(w, a);
  return x + a + 0.5 * b + (1.0 / 6) * glm::cross(w, b);
}

}  // namespace fastibl
