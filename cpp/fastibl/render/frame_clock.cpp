#include "fastibl/render/frame_clock.h"

#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {

double FrameClock::at(double given) {
  check(!given_ || given >= *given_, "time must not run backwards: ", given, " s after ",
        given_.value_or(0), " s");
  if (given_ && given - *given_ > kLongest) ahead_ = *now_ + kLongest - given;
  if (!given_ && now_) ahead_ = *now_ + kPause - given;
  if (!now_ && std::abs(given) > kLatest) ahead_ = -given;
  given_ = given, now_ = given + ahead_;
  return *now_;
}

}  // namespace fastibl
