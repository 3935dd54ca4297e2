// Detects the flicker of lamps on the mains, whose light swings 100 or 120 times a second.
#pragma once

#include <vector>

namespace fastibl {

// Exposures shorter than a swing catch it at any height: pictures of the same exposure differ by
// one factor all over, up and down. They are levelled: each is taken as bright as the map, which
// moves towards the mean of the last pictures. What does not go up and down is not flicker. A swing
// that pictures catch at the same height every time (because its rate is a multiple of theirs) is
// not seen.
class FlickerWatch {
 public:
  struct Levelled {
    double log_factor = 0;  // on the exposure that came with the picture
    double swing = 0;       // standard deviation of the last pictures, relative
  };

  // log_ratio: ln of what a picture shows over what the map and its exposure let expect; deviation:
  // standard deviation of that. time: seconds. False where the exposure was not seen to flicker.
  bool watch(double exposure, double log_ratio, double deviation, double time, Levelled& out);

 private:
  struct Seen {
    double exposure, log_ratio, deviation, time;
  };
  std::vector<Seen> seen_;  // in order of time
};

}  // namespace fastibl
