// Tells whether somebody moves the board: it then turns against its surroundings.
#pragma once

#include <optional>

#include "fastibl/core/pose.h"
#include "fastibl/tracking/rotation_tracker.h"

namespace fastibl {

struct BoardMotionOptions {
  double least = 1.5;  // degrees that the board must have turned; and 5 standard deviations
  // Metres to the surroundings, which seem to turn as the camera moves: at least `nearest`, or at
  // least `farther` where board and surroundings agreed while the camera moved by `proof` metres.
  double nearest = 1.5, farther = 10, proof = 0.15;
  double still =
      0.3;         // degrees by which surroundings seem to turn at most where the camera is still
  int frames = 5;  // frames in a row that must say the same
  double steady = 1.0;  // degrees within which these must agree; or 3 standard deviations
  double longest = 2;   // seconds without news of the surroundings after which the board counts
};

// Compares, frame by frame, the pose by the board with what the surroundings say. If the two poses
// stay apart steadily, the board lies elsewhere; while they are apart and not steady, it moves.
// Only a turn of the board is seen, not that it was pushed along. Where the surroundings stand
// still in the pictures, so does the camera, however near they are: as it moved around the board,
// they would have to lie on the axis of its turn.
class BoardMotion {
 public:
  explicit BoardMotion(BoardMotionOptions options = {}) : options_(options) {}

  // around: the pose by the surroundings, where these do not agree and one was found, or by a
  // gyroscope alone.
  void look(const Pose& board, Agreement agreement, const std::optional<Turned>& around,
            double time);
  bool moving() const { return apart_ > 0; }
  // newmarker_from_oldmarker, once.
  std::optional<glm::dmat3> moved();

 private:
  BoardMotionOptions options_;
  glm::dvec3 eye_{0};  // place of the camera when both last agreed, marker frame
  bool has_eye_ = false;
  std::optional<glm::dmat3> start_;  // camera_from_marker, from which the surroundings are followed
  glm::dvec3 anchor_{0};             // where both began to agree, marker frame
  double way_ = 0;                   // largest distance from there, metres
  int apart_ = 0, alike_ = 0;        // frames in a row
  glm::dmat3 offset_{1.0};           // newmarker_from_oldmarker
  // The first of those offsets that are alike: a board that turns slowly is not steady.
  glm::dmat3 first_offset_{1.0};
  double told_ = 0;  // seconds: when the surroundings last told anything
  std::optional<glm::dmat3> moved_;
};

}  // namespace fastibl
