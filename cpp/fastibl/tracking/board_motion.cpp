#include "fastibl/tracking/board_motion.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace fastibl {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kFollow = 0.02;  // share of a frame in the mean place of the camera

}  // namespace

void BoardMotion::look(const Pose& board, const std::optional<Turned>& around, bool agrees,
                       double time) {
  const glm::dvec3 eye = board.inverse().translation;
  bool apart = false;
  if (around) {
    told_ = time;
    const glm::dmat3 offset = glm::transpose(board.rotation) * around->back_from_marker.rotation;
    const double angle = rotation_angle(glm::dmat3(1.0), offset);
    // Parallax of what is near, as the camera is elsewhere than where the map was made from.
    const double parallax = has_eye_ ? glm::length(eye - eye_) / options_.nearest : 0;
    const double limit =
        std::max(options_.least * kDegree, 5 * around->deviation()) + std::min(parallax, 1.0);
    apart = angle > limit;
    const bool alike = apart_ > 0 && rotation_angle(offset_, offset) < options_.steady * kDegree;
    alike_ = apart ? (alike ? alike_ + 1 : 1) : 0;
    offset_ = offset;
  } else if (!agrees && apart_ > 0 && time - told_ < options_.longest) {
    apart = true;  // it goes on, though it cannot be measured here
  }
  apart_ = apart ? apart_ + 1 : 0;
  if (!apart) {
    alike_ = 0;
    eye_ = has_eye_ ? eye_ + kFollow * (eye - eye_) : eye;
    has_eye_ = true;
  }
  if (alike_ < options_.frames) return;
  moved_ = offset_;
  apart_ = alike_ = 0;
  eye_ = eye;
}

std::optional<glm::dmat3> BoardMotion::moved() { return std::exchange(moved_, std::nullopt); }

}  // namespace fastibl
