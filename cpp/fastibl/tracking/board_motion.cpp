#include "fastibl/tracking/board_motion.h"

#include <algorithm>
#include <numbers>
#include <utility>

namespace fastibl {

void BoardMotion::look(const Pose& board, Agreement agreement, const std::optional<Turned>& around,
                       double time) {
  const glm::dvec3 eye = board.inverse().translation;
  const double moved = has_eye_ ? glm::length(eye - eye_) : 0;
  bool apart = false;
  if (agreement == Agreement::agrees) {
    told_ = time;
    if (way_ == 0) anchor_ = eye;
    way_ = std::max({way_, 1e-6, glm::length(eye - anchor_)});
  } else if (around) {
    told_ = time;
    const glm::dmat3 offset = glm::transpose(board.rotation) * around->back_from_marker.rotation;
    const double angle = rotation_angle(glm::dmat3(1.0), offset);
    // Parallax, as the camera is elsewhere than where they last agreed; a gyroscope has none.
    const double distance = way_ >= options_.proof ? options_.farther : options_.nearest;
    const double turned =
        start_ ? rotation_angle(*start_, around->back_from_marker.rotation) : std::numbers::pi;
    const bool still = turned < options_.still * kDegree + around->deviation();
    const double parallax = around->features > 0 && !still ? std::min(moved / distance, 1.0) : 0;
    const double limit = std::max(options_.least * kDegree, 5 * around->deviation()) + parallax;
    apart = angle > limit;
    const double steady = std::max(options_.steady * kDegree, 3 * around->deviation());
    const bool alike = alike_ > 0 && rotation_angle(first_offset_, offset) < steady;
    alike_ = apart ? (alike ? alike_ + 1 : 1) : 0;
    if (!alike) first_offset_ = offset;
    offset_ = offset;
    if (!apart && angle > 0.5 * options_.least * kDegree && distance == options_.nearest) way_ = 0;
  } else if (agreement == Agreement::differs) {
    // Near surroundings differ whenever the camera moves; far ones do not.
    apart = (apart_ > 0 || way_ >= options_.proof) && time - told_ < options_.longest;
    if (!apart) way_ = 0;
  } else {
    apart = apart_ > 0 && time - told_ < options_.longest;
  }
  apart_ = apart ? apart_ + 1 : 0;
  if (!apart) {
    start_ = board.rotation;
    alike_ = 0;
    if (agreement == Agreement::agrees || around || !has_eye_) eye_ = eye, has_eye_ = true;
  }
  if (alike_ < options_.frames) return;
  moved_ = offset_;
  apart_ = alike_ = 0, way_ = 0;
  eye_ = eye, start_ = board.rotation;
}

std::optional<glm::dmat3> BoardMotion::moved() { return std::exchange(moved_, std::nullopt); }

}  // namespace fastibl
