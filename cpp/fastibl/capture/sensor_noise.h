// How much a sample of a camera is to be trusted.
#pragma once

#include <array>
#include <cstddef>

#include "fastibl/scene/pixel_reader.h"
#include "fastibl/scene/response.h"

namespace fastibl {

// Variance of a mean over pixels, by its linear value y: read and shot noise, and a code of
// quantisation. The first two are cut off at 0, and codes repeat (a dark wall is all of one code).
// Such errors do not average out, so a quarter of the variance stays however large the footprint:
// v/4 + (3 v/4 + shot y) / pixels. v is a polynomial in y through its values at Chebyshev's points,
// plus what noise the dark parts of the last picture have beyond that.
class SensorNoise {
 public:
  // For a full well of 4000 electrons and a read noise of 6: variance per linear value, and at 0.
  static constexpr float kShotNoise = 1 / 4000.0f;
  static constexpr float kReadNoise = 6 / 4000.0f * 6 / 4000.0f;
  static constexpr std::size_t kTerms = 5;

  explicit SensorNoise(const Response& response);
  // Coefficients of y⁰, y¹, …; where the polynomial is below kReadNoise, it is not to be believed.
  const std::array<float, kTerms>& code_variance() const { return code_variance_; }

  // Measures how noisy a picture is where it is dark. With fewer than some hundred dark places,
  // what was known stays.
  void listen(const PixelReader& pixels, int width, int height);
  float more() const { return more_; }  // variance beyond that of the sensor above
  // Standard deviation of a dark pixel, where pictures show that noise is cut off at 0; else 0.
  float cut_off() const { return cut_off_; }

 private:
  float more_ = 0, cut_off_ = 0;
  std::array<float, kTerms> code_variance_{};
};

}  // namespace fastibl
