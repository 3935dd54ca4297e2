// Takes one step of the light's work in each frame, where a frame has no time for all of them.
#pragma once

#include <array>

namespace fastibl {

enum class LightStep {
  front,  // the front picture into the map
  back,   // the back picture
  light,  // what is made from the map: its levels, irradiance, shadow and all that rests on them
  look    // at the surroundings: whether the board still lies where it lay
};
inline constexpr int kLightSteps = 4;

// Which of the steps a frame takes.
class LightTurns {
 public:
  // Takes all wanted steps or, one by one, only the wanted step that has waited longest.
  void next(const std::array<bool, kLightSteps>& wanted, bool one_by_one) {
    ++frame_;
    taken_ = wanted;
    if (!one_by_one) return;
    int first = -1;
    for (int k = 0; k < kLightSteps; ++k)
      if (wanted[std::size_t(k)] &&
          (first < 0 || last_[std::size_t(k)] < last_[std::size_t(first)]))
        first = k;
    taken_ = {};
    if (first < 0) return;
    taken_[std::size_t(first)] = true, last_[std::size_t(first)] = frame_;
  }
  bool takes(LightStep step) const { return taken_[std::size_t(step)]; }

 private:
  long frame_ = 0;
  std::array<long, kLightSteps> last_{};
  std::array<bool, kLightSteps> taken_{};
};

}  // namespace fastibl
