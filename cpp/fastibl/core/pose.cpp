#include "fastibl/core/pose.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

// |RᵀR − 1|, element by element.
glm::dmat3 departure(const glm::dmat3& r) {
  const glm::dmat3 off = glm::transpose(r) * r - glm::dmat3(1.0);
  return {glm::abs(off[0]), glm::abs(off[1]), glm::abs(off[2])};
}

}  // namespace

void Pose::validate() const {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 3; ++r) {
      const double value = c < 3 ? rotation[c][r] : translation[r];
      check(std::isfinite(value), "a pose must be finite, got ", value, " at row ", r, ", column ",
            c);
    }
  const glm::dmat3 departures = departure(rotation);
  double off = 0;
  for (int c = 0; c < 3; ++c)
    for (int r = 0; r < 3; ++r) off = std::max(off, departures[c][r]);
  check(off < 1e-6, "the rotation of a pose must be orthonormal within 1e-6, got a departure of ",
        off);
  check(glm::determinant(rotation) > 0,
        "the rotation of a pose must have determinant +1, got a mirror");
}

Pose Pose::from_matrix(const glm::dmat4& m) {
  const Pose pose{glm::dmat3(m), glm::dvec3(m[3])};
  pose.validate();
  const glm::dvec4 last_row(m[0][3], m[1][3], m[2][3], m[3][3]), of_pose(0, 0, 0, 1);
  check(last_row == of_pose, "the last row of a pose must be 0 0 0 1, got ", last_row.x, " ",
        last_row.y, " ", last_row.z, " ", last_row.w,
        m[3] == of_pose ? "; its last column is: was a matrix that lists columns read as rows?"
                        : "");
  return pose;
}

Pose Pose::look_at(const glm::dvec3& eye, const glm::dvec3& target, const glm::dvec3& up) {
  constexpr double kParallel = 1e-9;  // sine
  for (int k = 0; k < 3; ++k)
    check(std::isfinite(eye[k]) && std::isfinite(target[k]) && std::isfinite(up[k]),
          "eye, target and up must be finite");
  const double far = glm::length(target - eye), size = glm::length(up);
  check(far > 0 && std::isfinite(far), "a camera must look at another point than its own place");
  check(size > 0 && std::isfinite(size), "up must be a direction, got a length of ", size);
  const glm::dvec3 forward = (target - eye) / far;
  glm::dvec3 right = glm::cross(forward, up / size);
  if (glm::length(right) < kParallel) {
    const bool steep = std::abs(forward.z) > 0.9;
    right = glm::cross(forward, steep ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1));
  }
  right = glm::normalize(right);
  const glm::dmat3 marker_from_camera(right, glm::cross(forward, right), forward);
  const glm::dmat3 rotation = glm::transpose(marker_from_camera);
  return {rotation, -(rotation * eye)};
}

bool is_rotation(const glm::dmat3& r, double tolerance) {
  const glm::dmat3 off = departure(r);
  double sum = 0;
  for (int c = 0; c < 3; ++c)
    for (int row = 0; row < 3; ++row) sum += off[c][row];  // a NaN is never less
  return sum < tolerance && glm::determinant(r) > 0;
}

glm::dmat4 Pose::matrix() const {
  glm::dmat4 m(rotation);
  m[3] = glm::dvec4(translation, 1.0);
  return m;
}

Pose Pose::inverse() const {
  const glm::dmat3 back = glm::transpose(rotation);
  return {back, -(back * translation)};
}

glm::dmat3 rotation_from_vector(const glm::dvec3& w) {
  const double angle2 = glm::dot(w, w);
  const double angle = std::sqrt(angle2);
  // sin(a)/a and (1 - cos a)/a² by their series where the quotient would lose digits.
  const double a = angle < 1e-4 ? 1.0 - angle2 / 6.0 : std::sin(angle) / angle;
  const double b = angle < 1e-4 ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
  const glm::dmat3 cross(0, w.z, -w.y, -w.z, 0, w.x, w.y, -w.x, 0);  // columns of [w]×
  return glm::dmat3(1.0) + a * cross + b * (cross * cross);
}

glm::dvec3 rotation_vector(const glm::dmat3& r) {
  const glm::dvec3 axis(r[1][2] - r[2][1], r[2][0] - r[0][2], r[0][1] - r[1][0]);
  const double cosine = r[0][0] + r[1][1] + r[2][2] - 1;  // twice, as are the axis and its length
  const double sine = glm::length(axis), angle = std::atan2(sine, cosine);
  if (cosine < -1.9) {
    // Near half a turn the axis is lost in the difference; R + Rᵀ − 2 cos I is (2 − 2 cos) u uᵀ,
    // whose longest column is the axis up to its sign.
    int longest = 0;
    for (int c = 1; c < 3; ++c)
      if (r[c][c] > r[longest][longest]) longest = c;
    glm::dvec3 u = r[longest] + glm::dvec3(r[0][longest], r[1][longest], r[2][longest]);
    u[longest] -= cosine;
    u = glm::normalize(u);
    return (glm::dot(u, axis) < 0 ? -angle : angle) * u;
  }
  return sine > 1e-12 ? axis * (angle / sine) : 0.5 * axis;
}

glm::dmat3 orthonormal(const glm::dmat3& r) {
  const glm::dvec3 x = glm::normalize(r[0]);
  const glm::dvec3 y = glm::normalize(r[1] - glm::dot(x, r[1]) * x);
  return {x, y, glm::cross(x, y)};
}

double rotation_angle(const glm::dmat3& a, const glm::dmat3& b) {
  const glm::dmat3 r = glm::transpose(a) * b;
  const glm::dvec3 axis(r[1][2] - r[2][1], r[2][0] - r[0][2], r[0][1] - r[1][0]);
  return std::atan2(glm::length(axis), r[0][0] + r[1][1] + r[2][2] - 1.0);
}

}  // namespace fastibl
