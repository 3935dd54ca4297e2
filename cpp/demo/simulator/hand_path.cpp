#include "demo/simulator/hand_path.h"

#include <cmath>
#include <numbers>

namespace fastibl::demo {
namespace {

constexpr double kRound = 18;  // seconds

// About −1 to 1: the sum of two waves with frequencies in Hz.
double wave(double time, double first, double second, double phase) {
  const double turn = 2 * std::numbers::pi * time;
  return 0.65 * std::sin(first * turn + phase) + 0.35 * std::sin(second * turn + 2.3 * phase);
}
double tremor(double time, double phase) {
  return wave(time, 3.1, 6.3, phase) + 0.3 * wave(time, 4.7, 7.9, 1.7 * phase);
}

}  // namespace

Pose hand_pose(double time) {
  const double azimuth =
      0.6 + 2 * std::numbers::pi * time / kRound + 0.06 * wave(time, 0.31, 0.53, 1);
  const double tilt = (43 + 18 * wave(time, 0.27, 0.61, 2)) * kDegree;
  const double distance = 0.525 + 0.07 * wave(time, 0.19, 0.43, 3);
  const glm::dvec3 away(std::sin(tilt) * std::sin(azimuth), -std::sin(tilt) * std::cos(azimuth),
                        std::cos(tilt));
  const glm::dvec3 shake(tremor(time, 1), tremor(time, 2), tremor(time, 3));
  const glm::dvec3 eye = distance * away + 0.0008 * shake;  // metres
  const glm::dvec3 aim(0.018 * wave(time, 0.23, 0.47, 4), 0.018 * wave(time, 0.29, 0.57, 5), 0.03);
  const glm::dvec3 forward = glm::normalize(aim - eye);
  const glm::dvec3 right = glm::normalize(glm::cross(forward, glm::dvec3(0, 0, 1)));
  const glm::dmat3 marker_from_camera(right, glm::cross(forward, right), forward);
  Pose pose;
  pose.rotation = rotation_from_vector({0.001 * tremor(time, 6), 0.001 * tremor(time, 7),
                                        0.05 * wave(time, 0.37, 0.71, 3)}) *
                  glm::transpose(marker_from_camera);
  pose.translation = -(pose.rotation * eye);
  return pose;
}

}  // namespace fastibl::demo
