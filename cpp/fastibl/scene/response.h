// From encoded picture values to linear ones and back: encoded = response(linear), white at 1.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace fastibl {

// A camera's response. Without a curve it is that of sRGB.
struct Response {
  // Linear values at evenly spaced encoded values, from 0 at 0 to 1 at 1. The curve is 0 up to the
  // black level and 1 from the white level on, and increases strictly between them.
  std::vector<float> curve = {};

  static Response srgb() { return {}; }
  static Response gamma(double exponent);                // linear = encoded^exponent
  static Response from_curve(std::vector<float> curve);  // throws as validate()
  // The same curve between other encoded levels, 0 ≤ black < white ≤ 1, to an eighth of an 8-bit
  // code: for video whose black is 16 and whose white is 235, or for a camera that lifts its black.
  // Throws std::invalid_argument for other levels.
  Response between(double black, double white) const;
  // Throws std::invalid_argument unless the curve is as stated above.
  void validate() const;

  // The encoded values of no light, and of the light at and beyond which everything is clipped.
  float black() const;
  float white() const;
  // The 8-bit code from which on a pixel counts as clipped: noise and blur push clipped pixels a
  // few codes down.
  int clipped_code() const;

  float decode(float encoded) const;  // first clamps to [0, 1]; NaN gives 0
  float encode(float linear) const;   // first clamps to [0, 1]; NaN gives black
  bool operator==(const Response&) const = default;
};

// The same for 8-bit pictures, by table; encoding rounds to the nearest code exactly.
class ByteResponse {
 public:
  explicit ByteResponse(const Response& response);
  float decode(std::uint8_t encoded) const { return decode_[encoded]; }
  std::uint8_t encode(float linear) const {
    if (!(linear > 0)) return black_;  // NaN too
    if (linear >= 1) return white_;
    // The guess is exact to one code; the thresholds between codes settle it.
    int code = guess_[std::size_t(linear * kGuesses)];
    while (linear >= upper_[std::size_t(code)]) ++code;
    return std::uint8_t(code);
  }
  // Many values at once, with the same results.
  void decode(const std::uint8_t* encoded, float* linear, std::size_t count) const;
  void encode(const float* linear, std::uint8_t* encoded, std::size_t count) const;
  int clipped_code() const { return clipped_code_; }
  // Multiplied by a factor between these two, no code's linear value becomes that of another code.
  float least_unseen() const { return least_unseen_; }
  float most_unseen() const { return most_unseen_; }

 private:
  static constexpr int kGuesses = 4096;
  std::array<float, 256> decode_{};
  std::array<float, 256> upper_{};              // linear value at which code k ends
  std::array<std::int32_t, kGuesses> guess_{};  // code at the lower end of each bin
  std::uint8_t black_ = 0, white_ = 255;
  int clipped_code_;
  int most_steps_ = 0;  // from a guess to the code
  // If that is at most 1: the code in 8 bits, and the last part of the bin that has it in 24 bits.
  std::array<std::uint32_t, kGuesses> step_{};
  float least_unseen_ = 0, most_unseen_ = 2;
};

}  // namespace fastibl
