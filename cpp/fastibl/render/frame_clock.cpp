#include "fastibl/render/frame_clock.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {

double FrameClock::at(double given) {
  check(!given_ || given >= *given_, "time must not run backwards: ", given, " s after ",
        given_.value_or(0), " s");
  if (given_ && given - *given_ <= kLongest) {
    now_ = std::max(*now_, given + ahead_);  // late times have coarse steps
  } else {
    if (given_)
      now_ = *now_ + kLongest;
    else if (now_)
      now_ = *now_ + kPause;
    else
      now_ = std::abs(given) > kLatest ? 0 : given;
    ahead_ = *now_ - given;
  }
  given_ = given;
  return *now_;
}

}  // namespace fastibl
