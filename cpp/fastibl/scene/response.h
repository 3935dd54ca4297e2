// From encoded picture values to linear ones and back: encoded = response(linear), white at 1.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace fastibl {

// A camera's response. Without a curve it is sRGB's.
struct Response {
  // Linear values at evenly spaced encoded values, from 0 at 0 to 1 at 1, strictly increasing.
  std::vector<float> curve;

  static Response srgb() { return {}; }
  static Response gamma(double exponent);                // linear = encoded^exponent
  static Response from_curve(std::vector<float> curve);  // throws as validate()
  // Throws std::invalid_argument unless the curve is as stated above.
  void validate() const;

  float decode(float encoded) const;  // clamped to [0, 1] before; NaN gives 0
  float encode(float linear) const;   // clamped to [0, 1] before; NaN gives 0
  bool operator==(const Response&) const = default;
};

// The same for 8-bit pictures, by table; encoding rounds to the nearest code exactly.
class ByteResponse {
 public:
  explicit ByteResponse(const Response& response);
  float decode(std::uint8_t encoded) const { return decode_[encoded]; }
  std::uint8_t encode(float linear) const {
    if (!(linear > 0)) return 0;  // NaN too
    if (linear >= 1) return 255;
    // The guess is exact to one code; the thresholds between codes settle it.
    int code = guess_[std::size_t(linear * kGuesses)];
    while (linear >= upper_[std::size_t(code)]) ++code;
    return std::uint8_t(code);
  }
  // Many at once: the same values and codes.
  void decode(const std::uint8_t* encoded, float* linear, std::size_t count) const;
  void encode(const float* linear, std::uint8_t* encoded, std::size_t count) const;
  // Factors between which the linear value of no code becomes that of another one.
  float least_unseen() const { return least_unseen_; }
  float most_unseen() const { return most_unseen_; }

 private:
  static constexpr int kGuesses = 4096;
  std::array<float, 256> decode_{};
  std::array<float, 256> upper_{};              // linear value at which code k ends
  std::array<std::int32_t, kGuesses> guess_{};  // code at the lower end of each bin
  int most_steps_ = 0;                          // from a guess to the code
  // Where that is 1 at most: the code in 8 bits, and the last part of the bin that has it in 24.
  std::array<std::uint32_t, kGuesses> step_{};
  float least_unseen_ = 0, most_unseen_ = 2;
};

}  // namespace fastibl
