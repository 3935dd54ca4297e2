#include "fastibl/capture/sensor_noise.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fastibl {
namespace {

constexpr int kColumns = 32, kRows = 24;  // of places that are looked at
constexpr int kApart = 2;                 // pixels: neighbours share noise in demosaiced pictures
constexpr float kDark = 0.02f;            // linear
constexpr std::size_t kLeast = 200;       // dark places
constexpr float kKept = 0.9f;             // share of them that is kept, without what may be edges,
constexpr float kKeptVariance = 0.623f;   // and its share of a normal variable's variance
constexpr float kCutOff = 0.25f;  // share at 0 from which on half of the noise is cut off there,
constexpr float kCutOffVariance = 3;  // so that its variance was three times what is left
// A normal variable's variance by what is found here where a share is cut off at 0: 1 + kCutSquare
// share², right within 5 % from no light on.
constexpr float kLeastCut = 0.1f, kCutSquare = 8;
constexpr float kUsual = 2;  // times the variance that is expected

}  // namespace

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

void SensorNoise::listen(const PixelReader& pixels, int width, int height) {
  std::array<float, std::size_t{kColumns} * kRows> squares;
  std::size_t count = 0, zeros = 0;
  float sum = 0;
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kColumns; ++column) {
      const int x = int((column + 0.5f) * float(width) / kColumns),
                y = int((row + 0.5f) * float(height) / kRows);
      if (x < kApart || x >= width - kApart) continue;
      const float b = pixels.linear(x, y).y;
      if (!(b < kDark)) continue;
      const float a = pixels.linear(x - kApart, y).y, c = pixels.linear(x + kApart, y).y;
      const float bend = a - 2 * b + c;
      squares[count++] = bend * bend / 6;
      zeros += b == 0;
      sum += b;
    }
  if (count < kLeast) return;
  const auto kept = std::size_t(kKept * float(count));
  std::nth_element(squares.begin(), squares.begin() + std::ptrdiff_t(kept),
                   squares.begin() + std::ptrdiff_t(count));
  float variance = 0;
  for (std::size_t i = 0; i < kept; ++i) variance += squares[i];
  variance /= kKeptVariance * float(kept);
  const float cut = float(zeros) / float(count);
  if (cut > kLeastCut)
    cut_off_ = std::sqrt(variance * (1 + kCutSquare * cut * cut));
  else if (sum / float(count) < cut_off_)
    cut_off_ = 0;  // as dark, and hardly anything is 0
  if (cut > kCutOff) variance *= kCutOffVariance;
  const float expected = kReadNoise + kShotNoise * sum / float(count);
  more_ = std::max(variance - kUsual * expected, 0.0f);
}

}  // namespace fastibl
