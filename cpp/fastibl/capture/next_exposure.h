// Which exposure shows most of what a map still lacks.
#pragma once

#include <array>

namespace fastibl {

// How much light the texels that a camera sees hold and how well it is known, by half stops of
// radiance. In radiance times solid angle.
class LightLacks {
 public:
  // relative: standard deviation of the radiance, relative to it. pixels: how many the texel
  // covers.
  void add_known(double radiance, double angle, double relative, double pixels);
  // bound: the radiance is at least this.
  void add_bound(double bound, double angle, double pixels);
  void add_unseen(double angle, double pixels);
  // By how much a picture of this exposure (times the camera's gain) is expected to reduce the
  // error of the light's sum, in radiance times solid angle. mean: radiance that is expected where
  // nothing was seen.
  double gain_of(double exposure, double mean) const;

 private:
  static constexpr int kBins = 128;  // from 2^-32 on
  struct Bin {
    double light = 0, unsure = 0;  // unsure: times the relative deviation
    double bound = 0;
  };
  std::array<Bin, kBins> bins_{};
  double unseen_ = 0;                     // solid angle
  double pixels_ = 0, pixels_count_ = 0;  // mean of what a texel covers
};

struct ExposureRange {
  double shortest = 1e-6, longest = 1;  // multipliers
};

// The exposure that gains most, among steps of a stop through the range from the longest on.
double next_exposure(const LightLacks& lacks, double mean, const ExposureRange& range, double gain);

}  // namespace fastibl
