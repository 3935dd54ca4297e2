#include "fastibl/render/time_budget.h"

#include <algorithm>

namespace fastibl {

bool TimeBudget::add(double milliseconds, double planned, double budget, bool shaded) {
  constexpr double kUp = 1.25, kDown = 0.9, kLeast = 0.3;
  if (failed_ > 0 && ++since_failed_ > kForget) failed_ = 0;
  times_.push_back(shaded ? milliseconds : std::max(milliseconds, kSlack * budget));
  int slow = 0;
  for (const double t : times_) slow += t > budget;
  double next = slowdown_;
  if (slow > kFrames / 10) {
    failed_ = slowdown_, since_failed_ = 0;
    if (planned <= budget)
      next = slowdown_ * kUp;
    else
      spreads_ = true;
  } else if (int(times_.size()) < kFrames) {
    return false;
  } else if (*std::max_element(times_.begin(), times_.end()) < kSlack * budget) {
    if (spreads_) {
      spreads_ = failed_ > 0;
    } else {
      next = std::max(slowdown_ * kDown, kLeast);
      if (next <= failed_) next = slowdown_;
    }
  }
  times_.clear();
  if (next == slowdown_) return false;
  slowdown_ = next;
  return true;
}

}  // namespace fastibl
