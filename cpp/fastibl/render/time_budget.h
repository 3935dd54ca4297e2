// Whether frames keep to a time, and how much slower than by the cost table they are to be planned.
#pragma once

#include <vector>

namespace fastibl {

// Looks at the last frames, all of one plan. More than a tenth of them too slow: the slowdown
// rises by a quarter, so that the next plan is cheaper; where none is, the light's work is spread
// over frames. All of them far quicker: the same backwards, the slowdown by a tenth, but for
// kForget frames never back to where frames were too slow: nothing swings.
class TimeBudget {
 public:
  static constexpr int kFrames = 30;     // that are looked at
  static constexpr int kForget = 600;    // frames
  static constexpr double kSlack = 0.7;  // of the budget

  double slowdown() const { return slowdown_; }
  bool spreads() const { return spreads_; }  // see LightTurns
  // planned: milliseconds of a frame by the plan; where that is over the budget already, nothing is
  // cheaper. True where the slowdown changed; a plan that is another then has to be restart()ed
  // with.
  bool add(double milliseconds, double planned, double budget);
  void restart() { times_.clear(); }

 private:
  std::vector<double> times_;
  double slowdown_ = 1, failed_ = 0;
  bool spreads_ = false;
  int since_failed_ = 0;
};

}  // namespace fastibl
