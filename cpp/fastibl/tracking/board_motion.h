// Whether somebody moves the board: it turns against its surroundings.
#pragma once

#include <optional>

#include "fastibl/core/pose.h"
#include "fastibl/tracking/rotation_tracker.h"

namespace fastibl {

struct BoardMotionOptions {
  double least = 1.5;    // degrees by which the board must have turned; and 5 standard deviations
  double nearest = 1.5;  // metres: things that are nearer seem to turn as the camera moves
  int frames = 5;        // in a row that must say the same
  double steady = 0.5;   // degrees within which these agree
  double longest = 2;    // seconds without a word of the surroundings after which the board counts
};

// Compares, frame by frame, the pose by the board with what the surroundings say. Two poses that
// are steadily apart mean that the board lies elsewhere; while they are apart and not steady, it
// moves. Only its turning is seen, not that it was pushed along.
class BoardMotion {
 public:
  explicit BoardMotion(BoardMotionOptions options = {}) : options_(options) {}

  // around: of the surroundings; nothing where they agree with the board or tell nothing.
  // agrees: they do agree.
  void look(const Pose& board, const std::optional<Turned>& around, bool agrees, double time);
  bool moving() const { return apart_ > 0; }
  // newmarker_from_oldmarker, once.
  std::optional<glm::dmat3> moved();

 private:
  BoardMotionOptions options_;
  glm::dvec3 eye_{0};  // mean place of the camera while they agreed, marker frame
  bool has_eye_ = false;
  int apart_ = 0, alike_ = 0;  // frames in a row
  glm::dmat3 offset_{1.0};     // newmarker_from_oldmarker
  double told_ = 0;            // seconds: when the surroundings last told anything
  std::optional<glm::dmat3> moved_;
};

}  // namespace fastibl
