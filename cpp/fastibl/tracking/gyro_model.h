// How late a gyroscope's attitudes come, and whether they are of this camera: found out while the
// board is in view.
#pragma once

#include <deque>
#include <optional>

#include "fastibl/core/pose.h"

namespace fastibl {

struct GyroOptions {
  double delay_deviation = 0.01;  // seconds, before anything is known
  double longest_gap = 0.25;      // seconds between frames that are compared
};

// An attitude as it would have come without delay: camera_from_rest, and the variance that the
// correction leaves of the turn since the frame before, rad², mean over the axes.
struct Attitude {
  glm::dmat3 rotation{1.0};
  double variance = 0;
};

// An attitude that is told δ late is that of δ before: off by δ times the rate. From frame to frame
// the board's turns and the told ones then differ by δ times the change of the rate (least squares
// over about a hundred frames), which a steady drift or a board moved by hand do not look like.
class GyroModel {
 public:
  explicit GyroModel(GyroOptions options = {}) : options_(options) {}

  // Of a frame, time not decreasing. Nothing where attitudes do not turn as the board does: axes
  // of another sensor, or stuck.
  std::optional<Attitude> add(double time, const glm::dmat3& camera_from_rest);
  // Of the same frame, where it was found: the rotation by the board, and its variance, rad².
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
  void compare();                        // the frames in the middle of the last four

  GyroOptions options_;
  std::deque<Frame> frames_;          // the last four without a gap
  double information_ = 0, sum_ = 0;  // of the delay
  double delay_ = 0, variance_ = 0;
  // Recent frames that turned, and of them the squared shares that were not as the board turned.
  double turned_ = 0, otherwise_ = 0;
};

}  // namespace fastibl
