// Whether a camera's word about its exposure is to be believed.
#pragma once

#include <optional>

#include "fastibl/capture/flicker_watch.h"
#include "fastibl/capture/picture_level.h"

namespace fastibl {

enum class TakenAs {
  told,       // with the exposure that came with the picture
  corrected,  // that contradicts the map all over the picture: with what the map says instead
  estimated,  // none came: from the map
  averaged,   // the light flickers at this exposure: as bright as the map, and towards the mean
  assumed,    // none came with the camera's first picture, of which the map knows nothing: 1
  left_out,   // it shows nothing of what it should, or none came and the map cannot tell
};

// How a picture was taken into the map.
struct Taken {
  TakenAs as = TakenAs::told;
  double exposure = 1;   // that was used
  glm::dvec3 tint{1};    // by channel, a factor on it, with the given one
  double deviation = 0;  // of ln(exposure), where it rests on the map
  double flicker = 0;    // relative standard deviation of the light, where that was averaged
  int probes = 0;        // parts of the picture that were compared with the map
};

// Of one camera. A whole picture brighter or darker than the map by one factor is a wrong exposure
// (or white balance) before it is a change of the place: such a change is seldom the same
// everywhere. It is believed when it stays.
class ExposureDoubt {
 public:
  // An exposure came with a picture; before that is judged, if it is.
  void tell() { placed_ = true, assumed_ = false; }
  // told: what came with the picture, or nothing.
  Taken judge(std::span<const LevelProbe> probes, std::optional<double> told, double time);
  // ln of the factor by which the last picture made sure that the place is another than the map
  // says, or that the map began with a wrong exposure: what is older is not to be compared with. 0:
  // it did not.
  double found_change() const { return change_; }
  // Whether all that the camera showed is in a scale that was assumed.
  bool assumed() const { return assumed_; }

 private:
  Taken without_word(std::span<const LevelProbe> probes);
  bool confirmed(const std::optional<glm::dvec3>& log_ratio, double time);
  struct Doubt {
    std::optional<glm::dvec3> log_ratio;
    double since = 0;  // seconds
    int pictures = 0;
    bool believed = false;
  };
  std::optional<Doubt> doubt_;
  FlickerWatch flicker_;
  bool placed_ = false;  // whether any picture was taken
  bool assumed_ = false;
  double change_ = 0;
};

}  // namespace fastibl
