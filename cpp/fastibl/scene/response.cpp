#include "fastibl/scene/response.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kLevelSteps = 8 * 255;  // of a curve between levels
constexpr int kBelowWhite = 5;        // codes by which a clipped pixel may be pushed down

}  // namespace

Response Response::gamma(double exponent) {
  check(exponent > 0 && std::isfinite(exponent), "a gamma must be positive and finite, got ",
        exponent);
  std::vector<float> curve(1025);
  for (std::size_t i = 0; i < curve.size(); ++i)
    curve[i] = float(std::pow(double(i) / double(curve.size() - 1), exponent));
  return {std::move(curve)};
}

Response Response::from_curve(std::vector<float> curve) {
  Response response{std::move(curve)};
  response.validate();
  return response;
}

void Response::validate() const {
  if (curve.empty()) return;
  check(curve.size() >= 2, "a response curve needs at least 2 values, got ", curve.size());
  check(curve.front() == 0 && curve.back() == 1, "a response curve must run from 0 to 1, got ",
        curve.front(), " to ", curve.back());
  for (std::size_t i = 1; i < curve.size(); ++i)
    check(curve[i] > curve[i - 1] || (curve[i] == curve[i - 1] && (curve[i] == 0 || curve[i] == 1)),
          "a response curve must increase strictly from its black level to its white level, got ",
          curve[i - 1], " then ", curve[i], " at ", i);
}

Response Response::between(double black, double white) const {
  check(black >= 0 && black < white && white <= 1,
        "levels must be 0 <= black < white <= 1 of the encoded range, got ", black, " and ", white);
  const double first = std::round(black * kLevelSteps), last = std::round(white * kLevelSteps);
  check(first < last, "levels must be at least an eighth of an 8-bit code apart, got ", black,
        " and ", white);
  if (first == 0 && last == kLevelSteps) return *this;
  std::vector<float> levels(kLevelSteps + 1);
  for (int i = 0; i <= kLevelSteps; ++i)
    levels[std::size_t(i)] = decode(float((i - first) / (last - first)));
  return from_curve(std::move(levels));
}

float Response::black() const {
  if (curve.empty()) return 0;
  return float(std::upper_bound(curve.begin(), curve.end(), 0.0f) - curve.begin() - 1) /
         float(curve.size() - 1);
}

float Response::white() const {
  if (curve.empty()) return 1;
  return float(std::lower_bound(curve.begin(), curve.end(), 1.0f) - curve.begin()) /
         float(curve.size() - 1);
}

int Response::clipped_code() const {
  const int first = int(black() * 255) + 1;  // the first code of any light
  return std::max(first, int(std::lround(white() * 255)) - kBelowWhite);
}

float Response::decode(float encoded) const {
  const float e = encoded > 0 ? std::min(encoded, 1.0f) : 0.0f;  // NaN gives 0
  if (curve.empty()) return e <= 0.04045f ? e / 12.92f : std::pow((e + 0.055f) / 1.055f, 2.4f);
  const float x = e * float(curve.size() - 1);
  const std::size_t i = std::min(std::size_t(x), curve.size() - 2);
  return curve[i] + (x - float(i)) * (curve[i + 1] - curve[i]);
}

float Response::encode(float linear) const {
  if (!(linear > 0)) return black();
  if (linear >= 1) return white();
  if (curve.empty())
    return linear <= 0.0031308f ? linear * 12.92f : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
  const auto above = std::upper_bound(curve.begin(), curve.end(), linear);
  const std::size_t i = std::size_t(above - curve.begin()) - 1;
  return (float(i) + (linear - curve[i]) / (curve[i + 1] - curve[i])) / float(curve.size() - 1);
}

namespace {

FASTIBL_CLONES
void look_up(const std::uint8_t* at, const float* table, std::size_t count, float* __restrict out) {
  for (std::size_t i = 0; i < count; ++i) out[i] = table[int(at[i])];
}

// As ByteResponse::encode(), with one look-up each: for guesses that are at most one code too low.
FASTIBL_CLONES
void encode_by_one_step(const float* linear, const std::uint32_t* step, int bins, std::size_t count,
                        std::uint8_t* __restrict out) {
  const float most = 1 - 0x1p-24f, scale = float(bins);
  for (std::size_t i = 0; i < count; ++i) {
    const float positive = linear[i] > 0 ? linear[i] : 0.0f;  // NaN too
    const float value = (positive < most ? positive : most) * scale;
    const std::int32_t bin = std::int32_t(value);
    const std::int32_t part = std::int32_t((value - float(bin)) * 0x1p24f);
    const std::int32_t code = std::int32_t(step[bin] >> 24), last = step[bin] & 0xffffff;
    out[i] = std::uint8_t(code + (part > last));
  }
}

}  // namespace

ByteResponse::ByteResponse(const Response& response) : clipped_code_(response.clipped_code()) {
  for (int k = 0; k < 256; ++k) {
    decode_[std::size_t(k)] = response.decode(float(k) / 255.0f);
    upper_[std::size_t(k)] = k < 255 ? response.decode((float(k) + 0.5f) / 255.0f) : 2.0f;
    // Rounds tiny values up to what the parts of a bin can tell: 2^-36.
    if (upper_[std::size_t(k)] * kGuesses < 1)
      upper_[std::size_t(k)] = std::ceil(upper_[std::size_t(k)] * 0x1p36f) * 0x1p-36f;
  }
  // White has the code of what is just below it: a level between two codes is one of them for both.
  while (white_ > 0 && upper_[std::size_t(white_) - 1] >= 1) --white_;
  int code = 0;
  for (int i = 0; i < kGuesses; ++i) {
    while (float(i) / kGuesses >= upper_[std::size_t(code)]) ++code;
    guess_[std::size_t(i)] = code;
    if (i > 0) most_steps_ = std::max(most_steps_, code - guess_[std::size_t(i) - 1]);
  }
  black_ = std::uint8_t(guess_[0]);
  most_steps_ = std::max(most_steps_, white_ - code);
  for (std::size_t i = 0; i < kGuesses; ++i) {
    const float end = upper_[std::size_t(guess_[i])] * kGuesses - float(i);
    const std::uint32_t last = end < 1 ? std::uint32_t(end * 0x1p24f) - 1 : 0xffffffu;
    step_[i] = std::uint32_t(guess_[i]) << 24 | last;
  }
  // Black stays black; what is beyond white is white, for any factor from 1 on.
  for (std::size_t k = std::size_t(black_) + 1; k <= white_; ++k) {
    const float slack = 1e-6f;  // of the products
    least_unseen_ = std::max(least_unseen_, upper_[k - 1] / decode_[k] * (1 + slack));
    if (k < white_) most_unseen_ = std::min(most_unseen_, upper_[k] / decode_[k] * (1 - slack));
  }
}

void ByteResponse::decode(const std::uint8_t* encoded, float* linear, std::size_t count) const {
  look_up(encoded, decode_.data(), count, linear);
}

void ByteResponse::encode(const float* linear, std::uint8_t* encoded, std::size_t count) const {
  if (most_steps_ <= 1)
    encode_by_one_step(linear, step_.data(), kGuesses, count, encoded);
  else
    for (std::size_t i = 0; i < count; ++i) encoded[i] = encode(linear[i]);
}

}  // namespace fastibl
