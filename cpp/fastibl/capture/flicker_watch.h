// Lamps on the mains, whose light swings 100 or 120 times a second.
#pragma once

#include <vector>

namespace fastibl {

// Exposures shorter than a swing catch it at any height: pictures of the same exposure differ by
// one factor all over, up and down. They are levelled: each is taken as bright as the map, which
// moves towards the mean of the last pictures. What does not go up and down is no flicker, and a
// swing that pictures catch at the same height every time (exactly as many a second as it divides
// by) is not seen.
class FlickerWatch {
 public:
  struct Levelled {
    double log_factor = 0;  // on the exposure that came with the picture
    double swing = 0;       // standard deviation of the last pictures, relative
  };

  // log_ratio: of what a picture shows by what the map and its exposure let expect; deviation: of
  // that. time: seconds. Nothing where its exposure was not seen to flicker.
  bool watch(double exposure, double log_ratio, double deviation, double time, Levelled& out);

 private:
  struct Seen {
    double exposure, log_ratio, deviation, time;
  };
  std::vector<Seen> seen_;  // in time
};

}  // namespace fastibl
