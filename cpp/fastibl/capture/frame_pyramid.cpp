#include "fastibl/capture/frame_pyramid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace fastibl {
namespace {

constexpr int kLevels = 5;
constexpr int kClippedCode = 250;  // noise and blur push a clipped pixel a few codes below 255

// Means of 2 × 2; an odd last row or column is repeated.
Image<float> halve(const Image<float>& fine) {
  Image<float> coarse((fine.width + 1) / 2, (fine.height + 1) / 2, fine.channels);
  const int n = fine.channels;
  for (int y = 0; y < coarse.height; ++y) {
    const float* a = fine.row(2 * y);
    const float* b = fine.row(std::min(2 * y + 1, fine.height - 1));
    float* out = coarse.row(y);
    for (int x = 0; x < coarse.width; ++x) {
      const int l = 2 * x * n, r = std::min(2 * x + 1, fine.width - 1) * n;
      for (int c = 0; c < n; ++c)
        out[x * n + c] = 0.25f * (a[l + c] + a[r + c] + b[l + c] + b[r + c]);
    }
  }
  return coarse;
}

// First level straight from the codes, without a full-size copy.
Image<float> halve_bytes(const Picture& picture, const ByteResponse& table) {
  std::array<float, 256> linear, clipped;
  for (int k = 0; k < 256; ++k) {
    linear[std::size_t(k)] = 0.25f * table.decode(std::uint8_t(k));
    clipped[std::size_t(k)] = k >= kClippedCode ? 0.25f : 0.0f;
  }
  Image<float> coarse((picture.width + 1) / 2, (picture.height + 1) / 2, 6);
  for (int y = 0; y < coarse.height; ++y) {
    const std::uint8_t* a = picture.row(2 * y);
    const std::uint8_t* b = picture.row(std::min(2 * y + 1, picture.height - 1));
    float* out = coarse.row(y);
    for (int x = 0; x < coarse.width; ++x, out += 6) {
      const int l = 6 * x, r = 3 * std::min(2 * x + 1, picture.width - 1);
      for (int c = 0; c < 3; ++c) {
        const std::uint8_t codes[4] = {a[l + c], a[r + c], b[l + c], b[r + c]};
        out[c] = linear[codes[0]] + linear[codes[1]] + linear[codes[2]] + linear[codes[3]];
        out[3 + c] = clipped[codes[0]] + clipped[codes[1]] + clipped[codes[2]] + clipped[codes[3]];
      }
    }
  }
  return coarse;
}

Image<float> with_clipping(const Picture& picture, const Response& response) {
  const Image<float> linear = linear_from(picture, response);
  // Float pictures are linear without a white point: nothing in them is clipped.
  const float limit = picture.type == PixelType::float32 ? std::numeric_limits<float>::infinity()
                                                         : response.decode(kClippedCode / 255.0f);
  Image<float> out(picture.width, picture.height, 6);
  for (std::size_t i = 0; i < linear.data.size() / 3; ++i)
    for (std::size_t c = 0; c < 3; ++c) {
      const float value = linear.data[3 * i + c];
      out.data[6 * i + c] = value;
      out.data[6 * i + 3 + c] = value >= limit ? 1.0f : 0.0f;
    }
  return out;
}

void bilinear(const Image<float>& image, float x, float y, float out[6]) {
  const float limit_x = float(image.width - 1), limit_y = float(image.height - 1);
  x = std::clamp(x - 0.5f, 0.0f, limit_x), y = std::clamp(y - 0.5f, 0.0f, limit_y);
  const int ix = std::min(int(x), std::max(image.width - 2, 0)),
            iy = std::min(int(y), std::max(image.height - 2, 0));
  const float fx = x - float(ix), fy = y - float(iy);
  const float* a = image.pixel(ix, iy);
  const float* b = image.pixel(ix, std::min(iy + 1, image.height - 1));
  const int right = ix + 1 < image.width ? 6 : 0;
  for (int c = 0; c < 6; ++c) {
    const float upper = a[c] + fx * (a[c + right] - a[c]),
                lower = b[c] + fx * (b[c + right] - b[c]);
    out[c] = upper + fy * (lower - upper);
  }
}

}  // namespace

FramePyramid::FramePyramid(const Picture& picture, const Response& response) {
  levels_.push_back(picture.type == PixelType::uint8 ? halve_bytes(picture, ByteResponse(response))
                                                     : halve(with_clipping(picture, response)));
  while (int(levels_.size()) < kLevels && std::min(levels_.back().width, levels_.back().height) > 1)
    levels_.push_back(halve(levels_.back()));
}

FootprintSample FramePyramid::sample(float x, float y, float width) const {
  // A bilinear tap on a level of cell c averages about 1.5 c: half a level finer than log2 of the
  // width.
  const float level =
      std::clamp(std::log2(std::max(width, 1.0f)) - 0.5f - kFirst, 0.0f, float(levels_.size() - 1));
  const int k = std::min(int(level), int(levels_.size()) - 1);
  const float f = level - float(k);
  float fine[6], coarse[6] = {};
  const float scale = 1.0f / float(1 << (k + kFirst));
  bilinear(levels_[std::size_t(k)], x * scale, y * scale, fine);
  if (f > 0) bilinear(levels_[std::size_t(k) + 1], x * scale * 0.5f, y * scale * 0.5f, coarse);
  FootprintSample out;
  for (int c = 0; c < 3; ++c) {
    out.linear[c] = fine[c] + f * (coarse[c] - fine[c]);
    out.clipped[c] = fine[3 + c] + f * (coarse[3 + c] - fine[3 + c]);
  }
  return out;
}

}  // namespace fastibl
