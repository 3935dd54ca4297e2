#include "fastibl/capture/sensor_noise.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fastibl {

SensorNoise::SensorNoise(const Response& response) {
  // Newton's form by divided differences, then multiplied out.
  std::array<double, kTerms> at{}, value{};
  for (std::size_t k = 0; k < kTerms; ++k) {
    at[k] = 0.5 - 0.5 * std::cos((double(k) + 0.5) / kTerms * std::numbers::pi);
    const float e = response.encode(float(at[k]));
    const double step = double(response.decode(std::min(1.0f, e + 0.5f / 255))) -
                        double(response.decode(std::max(0.0f, e - 0.5f / 255)));
    value[k] = step * step + double(kReadNoise);
  }
  for (std::size_t order = 1; order < kTerms; ++order)
    for (std::size_t k = kTerms - 1; k >= order; --k)
      value[k] = (value[k] - value[k - 1]) / (at[k] - at[k - order]);
  std::array<double, kTerms> sum{};
  for (std::size_t k = kTerms; k-- > 0;) {  // sum = value[k] + (x − at[k]) sum
    for (std::size_t i = kTerms - 1; i > 0; --i) sum[i] = sum[i - 1] - at[k] * sum[i];
    sum[0] = value[k] - at[k] * sum[0];
  }
  for (std::size_t i = 0; i < kTerms; ++i) code_variance_[i] = float(sum[i]);
}

}  // namespace fastibl
