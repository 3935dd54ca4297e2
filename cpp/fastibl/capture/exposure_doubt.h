// Whether the exposure that a camera tells is to be believed.
#pragma once

#include <optional>

#include "fastibl/capture/flicker_watch.h"
#include "fastibl/capture/picture_level.h"

namespace fastibl {

enum class TakenAs {
  told,       // with the exposure that came with the picture
  corrected,  // that exposure contradicts the map all over the picture: with what the map says
  estimated,  // no exposure came: with one estimated from the map
  averaged,   // the light flickers at this exposure: as bright as the map, and towards the mean
  assumed,    // none came, and the map knows nothing of what the camera's first pictures show, or
              // those of some time: with what the board's white says, else with the last one, or 1
  left_out,   // it shows nothing of what it should, or no exposure came and the map cannot tell yet
};

// How a picture was taken into the map.
struct Taken {
  double grey_tint() const { return (tint.x + tint.y + tint.z) / 3; }  // of what is grey

  TakenAs as = TakenAs::told;
  double exposure = 1;   // the one that was used
  glm::dvec3 tint{1};    // by channel, a factor on the exposure, including the given tint
  double deviation = 0;  // of ln(exposure), where it rests on the map
  double flicker = 0;    // relative standard deviation of the light, where it was averaged
  int probes = 0;        // parts of the picture that were compared with the map
};

// Doubts about one camera. A picture that is brighter or darker than the map by one factor all over
// is first taken for wrongly exposed (or white-balanced), not for a change of the place: such a
// change is seldom the same everywhere. A change is believed when it stays. So is what contradicts
// the map, or shows nothing of it, where no exposure came.
class ExposureDoubt {
 public:
  // For when an exposure came with a picture; to be called before the picture is judged, if it is.
  void tell() { placed_ = true, assumed_ = false; }
  // told: what came with the picture, or nothing. probes: reordered; those that are not sure count
  // only where nothing was told and too few are sure.
  Taken judge(std::span<LevelProbe> probes, std::optional<double> told, double time);
  // For when a picture was taken with an exposure other than the judged one.
  void assume(double exposure) { last_ = exposure; }
  // ln of the factor by channel by which, as the last picture confirmed, the place differs from the
  // map, or the map began with a wrong exposure: what is older must not be compared with as it is.
  // Nothing if it confirmed nothing.
  const std::optional<glm::dvec3>& found_change() const { return change_; }
  // Whether all that the camera showed is in a scale that was assumed.
  bool assumed() const { return assumed_; }

 private:
  Taken without_word(std::span<const LevelProbe> sure, std::span<const LevelProbe> all,
                     double time);
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
  double last_ = 1;  // exposure that was used
  std::optional<glm::dvec3> change_;
};

}  // namespace fastibl
