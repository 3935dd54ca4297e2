// Frames' times, which may start anew, as one time that never runs backwards.
#pragma once

#include <optional>

namespace fastibl {

class FrameClock {
 public:
  static constexpr double kPause = 1;  // seconds: what counts as passed where times start anew
  // Seconds: a later first time, and a longer step, are no seconds or a slip. They count as no time
  // and as this long, so that frames are told apart when right times come.
  static constexpr double kLatest = 1e12, kLongest = 1e8;

  // The time of a frame of this time, seconds. Throws std::invalid_argument for one before the last
  // frame's.
  double at(double given);
  // The next frame may have any time.
  void restart() { given_.reset(); }

 private:
  std::optional<double> given_;  // of the last frame, as it was given
  std::optional<double> now_;    // and as it is
  double ahead_ = 0;
};

}  // namespace fastibl
