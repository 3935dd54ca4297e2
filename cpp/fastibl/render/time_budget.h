// Checks whether frames keep to a time, and how much slower than by the cost table to plan them.
#pragma once

#include <vector>

namespace fastibl {

// Looks at the last frames, all of one plan. If more than a tenth are too slow, the slowdown rises
// by a quarter, so that the next plan is cheaper; where no plan is cheaper, the light's work is
// spread over frames. If all of them are far quicker than the budget, these steps are taken back,
// the slowdown by a tenth; but for kForget frames never to where frames were too slow, so that
// nothing swings. Frames that shade nothing are quick whatever the plan: they take nothing back.
class TimeBudget {
 public:
  static constexpr int kFrames = 30;     // frames that are looked at
  static constexpr int kForget = 600;    // frames
  static constexpr double kSlack = 0.7;  // of the budget

  double slowdown() const { return slowdown_; }
  bool spreads() const { return spreads_; }  // see LightTurns
  // planned: milliseconds of a frame by the plan; where these exceed the budget already, no plan is
  // cheaper. shaded: whether the object was shaded anew. True where the slowdown changed; call
  // restart() if that leads to another plan.
  bool add(double milliseconds, double planned, double budget, bool shaded = true);
  void restart() { times_.clear(); }

 private:
  std::vector<double> times_;
  double slowdown_ = 1, failed_ = 0;
  bool spreads_ = false;
  int since_failed_ = 0;
};

}  // namespace fastibl
