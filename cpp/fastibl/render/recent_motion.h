// Tells how a camera moves now, from the poses of its last pictures.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/scene/row_motion.h"

namespace fastibl {

// A motion, and the seconds that it takes.
struct MotionRate {
  RowMotion motion;
  double seconds = 1;
  Pose later(const Pose& pose, double time) const { return motion.moved(pose, time / seconds); }
};

// Remembers up to three poses. Two that are no more than 0.25 s apart give a velocity in between;
// three also give the acceleration, and with it the motion at the last pose.
class RecentMotion {
 public:
  void add(double time, const Pose& camera_from_marker);
  std::optional<MotionRate> motion() const;  // at the last pose

 private:
  struct Moment {
    double time;
    Pose pose;
  };
  std::vector<Moment> moments_;  // in order
};

}  // namespace fastibl
