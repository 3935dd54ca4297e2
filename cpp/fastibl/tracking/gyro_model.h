// Finds out, while the board is in view, how late a gyroscope's attitudes come, and whether they
// are of this camera.
#pragma once

#include <deque>
#include <optional>

#include "fastibl/core/pose.h"

namespace fastibl {

struct GyroOptions {
  double delay_deviation = 0.01;  // seconds, before anything is known
  double longest_gap = 0.25;      // longest time between compared frames, seconds
};

// An attitude as it would have come without delay: camera_from_rest, and the variance that the
// correction leaves in the turn since the previous frame, rad², mean over the axes.
struct Attitude {
  glm::dmat3 rotation{1.0};
  double variance = 0;
};

// An attitude that comes δ late is the one of δ before: it is off by δ times the rate. So from
// frame to frame, the turns by the board and by the gyroscope differ by δ times the change of the
// rate (least squares over about a hundred frames). Neither a steady drift nor a board moved by
// hand looks like that.
class GyroModel {
 public:
  explicit GyroModel(GyroOptions options = {}) : options_(options) {}

  // Adds a frame's attitude, time not decreasing. Nothing where attitudes do not turn as the board
  // does: they have another sensor's axes, or are stuck.
  std::optional<Attitude> add(double time, const glm::dmat3& camera_from_rest);
  // Adds, for the same frame, the rotation by the board where it was found, and its variance, rad².
  void add_board(const glm::dmat3& camera_from_marker, double variance);

  double delay() const { return delay_; }  // seconds; negative: early
  bool trusted() const;

 private:
  struct Frame {
    double time;
    glm::dmat3 attitude;
    std::optional<glm::dmat3> board = {};
    double variance = 0;
  };
  glm::dvec3 rate(std::size_t k) const;  // from frame k − 1 to k
  void compare();                        // compares the two middle ones of the last four frames

  GyroOptions options_;
  std::deque<Frame> frames_;          // the last four without a gap
  double information_ = 0, sum_ = 0;  // of the delay
  double delay_ = 0, variance_ = 0;
  // Recent frames that turned, and the sum of their squared shares that did not turn as the board
  // did.
  double turned_ = 0, otherwise_ = 0;
};

}  // namespace fastibl
