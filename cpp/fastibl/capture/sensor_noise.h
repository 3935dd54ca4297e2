// How much an 8-bit sample of a camera is to be trusted.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "fastibl/scene/response.h"

namespace fastibl {

// Variance of a mean over pixels by its linear value y: read and shot noise, and a code of
// quantisation. The first two are cut off at 0, and codes repeat (a dark wall is all of one): such
// departures do not average away, so a quarter of the variance stays however large the footprint:
// v/4 + (3 v/4 + shot y) / pixels, v by table over √y, finer in the dark.
class SensorNoise {
 public:
  // A full well of 4000 electrons and 6 of read noise: variance per linear value, and at 0.
  static constexpr float kShotNoise = 1 / 4000.0f;
  static constexpr float kReadNoise = 6 / 4000.0f * 6 / 4000.0f;
  static constexpr int kBins = 256;

  explicit SensorNoise(const Response& response) {
    for (int k = 0; k <= kBins; ++k) {
      const float y = float(k) / kBins * float(k) / kBins;
      const float e = response.encode(y);
      const float step = response.decode(std::min(1.0f, e + 0.5f / 255)) -
                         response.decode(std::max(0.0f, e - 0.5f / 255));
      variance_[std::size_t(k)] = step * step + kReadNoise;
    }
  }
  const float* table() const { return variance_.data(); }

 private:
  std::array<float, kBins + 1> variance_{};
};

}  // namespace fastibl
