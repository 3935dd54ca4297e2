#include "fastibl/capture/next_exposure.h"

#include <algorithm>
#include <cmath>

#include "fastibl/capture/sensor_noise.h"
#include "fastibl/capture/texel_state.h"

namespace fastibl {
namespace {

constexpr int kLowest = -32;       // log2 of the first bin's radiance
constexpr double kClipped = 0.85;  // of white: with noise and blur some pixels of a texel clip
constexpr double kQuantum = 1 / 255.0 * 0.29;  // of 8 bit, at the bright end of an sRGB response
// A bound is taken to be up to this many stops brighter, all equally likely, and on average as much
// brighter as half of them.
constexpr double kStops = 4;
// How the unseen spreads around the mean: stops, and shares of the solid angle.
constexpr struct {
  double stops, share;
} kUnseen[] = {{-3, 0.25}, {-1, 0.35}, {1, 0.25}, {4, 0.15}};

int bin_of(double radiance) {
  const double bin = 2 * (std::log2(std::max(radiance, 1e-9)) - kLowest);
  return std::clamp(int(bin), 0, 127);
}
double radiance_of(int bin) { return std::exp2(kLowest + (bin + 0.5) / 2); }

// Relative standard deviation of a sample of this linear value.
double deviation(double linear, double pixels) {
  const double noise = SensorNoise::kReadNoise + SensorNoise::kShotNoise * linear +
                       kQuantum * kQuantum * std::max(linear, 0.01);
  return std::hypot(double(kModelNoise), std::sqrt(noise / std::max(1.0, pixels)) / linear);
}

// The deviation that is left after a sample.
double left(double before, double sample) { return before * sample / std::hypot(before, sample); }

}  // namespace

void LightLacks::add_known(double radiance, double angle, double relative, double pixels) {
  Bin& bin = bins_[std::size_t(bin_of(radiance))];
  bin.light += radiance * angle, bin.unsure += radiance * angle * std::min(relative, 1.0);
  pixels_ += pixels, ++pixels_count_;
}

void LightLacks::add_bound(double bound, double angle, double pixels) {
  bins_[std::size_t(bin_of(bound))].bound += bound * angle;
  pixels_ += pixels, ++pixels_count_;
}

void LightLacks::add_unseen(double angle, double pixels) {
  unseen_ += angle;
  pixels_ += pixels, ++pixels_count_;
}

double LightLacks::gain_of(double exposure, double mean) const {
  const double pixels = pixels_count_ > 0 ? pixels_ / pixels_count_ : 1;
  double sum = 0;
  for (int k = 0; k < kBins; ++k) {
    const Bin& bin = bins_[std::size_t(k)];
    const double linear = radiance_of(k) * exposure;
    if (bin.light > 0 && linear < kClipped) {
      const double before = bin.unsure / bin.light;
      sum += bin.light * (before - left(before, deviation(linear, pixels)));
    }
    if (bin.bound > 0) {
      const double resolved = std::clamp(std::log2(kClipped / linear) / kStops, 0.0, 1.0);
      const double brighter = std::exp2(kStops / 2);
      const double after = left(1, deviation(linear * brighter, pixels));
      sum += bin.bound * brighter * resolved * (1 - after);
    }
  }
  for (const auto& [stops, share] : kUnseen) {
    const double radiance = mean * std::exp2(stops), linear = radiance * exposure;
    // What clips is at least seen to be bright.
    const double after = linear < kClipped ? left(1, deviation(linear, pixels)) : 0.8;
    sum += unseen_ * share * radiance * (1 - after);
  }
  return sum;
}

double next_exposure(const LightLacks& lacks, double mean, const ExposureRange& range,
                     double gain) {
  double best = range.longest, most = -1;
  for (double exposure = range.longest; exposure >= range.shortest; exposure /= 2) {
    const double value = lacks.gain_of(exposure * gain, mean);
    if (value > most) best = exposure, most = value;
  }
  return best;
}

}  // namespace fastibl
