// A rigid transform, named target_from_source: x_in_target = target_from_source * x_in_source.
#pragma once

#include "fastibl/core/vector.h"

namespace fastibl {

struct Pose {
  glm::dmat3 rotation{1.0};     // orthonormal, determinant +1
  glm::dvec3 translation{0.0};  // metres

  // Throws std::invalid_argument unless this is a rigid transform: columns orthonormal within 1e-6,
  // determinant +1, all finite.
  void validate() const;
  // Does not re-orthonormalise. Throws as validate() does, and for a last row other than 0 0 0 1.
  static Pose from_matrix(const glm::dmat4& matrix);
  // camera_from_marker of a camera at `eye` (x right, y down, z forward) that sees `target` in the
  // middle of its picture and `up` upwards; if it looks along `up`, another direction is upwards.
  // Throws std::invalid_argument where `eye` and `target` are one point, `up` is 0, or
  // anything is not finite.
  static Pose look_at(const glm::dvec3& eye, const glm::dvec3& target,
                      const glm::dvec3& up = {0, 0, 1});
  glm::dmat4 matrix() const;
  Pose inverse() const;

  bool operator==(const Pose&) const = default;
};

// Whether the elements of |RᵀR − 1| sum to less than `tolerance`, and r is not a mirror.
bool is_rotation(const glm::dmat3& r, double tolerance);

inline Pose operator*(const Pose& a, const Pose& b) {
  return {a.rotation * b.rotation, a.rotation * b.translation + a.translation};
}
inline glm::dvec3 operator*(const Pose& pose, const glm::dvec3& point) {
  return pose.rotation * point + pose.translation;
}

// Rotation by |w| radians about w (Rodrigues), stable for |w| → 0.
glm::dmat3 rotation_from_vector(const glm::dvec3& w);
// The inverse of rotation_from_vector, up to half a turn; at exactly that, either of the two
// vectors.
glm::dvec3 rotation_vector(const glm::dmat3& r);
// Makes a rotation that rounding has distorted a little orthonormal again.
glm::dmat3 orthonormal(const glm::dmat3& r);
// Angle in radians of the rotation between a and b, stable near 0 and π.
double rotation_angle(const glm::dmat3& a, const glm::dmat3& b);

}  // namespace fastibl
