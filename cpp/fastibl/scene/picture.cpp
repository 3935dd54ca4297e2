#include "fastibl/scene/picture.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "fastibl/core/simd.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

namespace {

FASTIBL_CLONES
void luma(const std::uint8_t* rgb, int count, std::uint8_t* grey) {
  for (int i = 0; i < count; ++i)
    grey[i] = std::uint8_t(
        (rgb[3 * i] * 19595u + rgb[3 * i + 1] * 38470u + rgb[3 * i + 2] * 7471u + 32768u) >> 16);
}

}  // namespace

Image<float> linear_from(const Picture& picture, const Response& response) {
  check(!picture.empty(), "the picture has no pixels");
  Image<float> out(picture.width, picture.height, 3);
  const int count = 3 * picture.width;
  if (picture.type == PixelType::uint8) {
    const ByteResponse table(response);
    for (int y = 0; y < picture.height; ++y) {
      const std::uint8_t* in = picture.row(y);
      float* to = out.row(y);
      for (int i = 0; i < count; ++i) to[i] = table.decode(in[i]);
    }
  } else if (picture.type == PixelType::uint16) {
    std::vector<float> table(65536);
    for (std::size_t i = 0; i < table.size(); ++i) table[i] = response.decode(float(i) / 65535.0f);
    for (int y = 0; y < picture.height; ++y) {
      const auto* in = reinterpret_cast<const std::uint16_t*>(picture.row(y));
      float* to = out.row(y);
      for (int i = 0; i < count; ++i) to[i] = table[in[i]];
    }
  } else {
    for (int y = 0; y < picture.height; ++y) {
      const auto* in = reinterpret_cast<const float*>(picture.row(y));
      float* to = out.row(y);
      for (int i = 0; i < count; ++i)
        to[i] = std::clamp(std::isnan(in[i]) ? 0.0f : in[i], 0.0f, kRadianceCap);
    }
  }
  return out;
}

float scale_below_white(const Picture& picture) {
  if (picture.type != PixelType::float32) return 1;
  constexpr int kSamples = 200;    // along an edge
  constexpr double kBelow = 0.99;  // of them
  const int dx = std::max(1, picture.width / kSamples), dy = std::max(1, picture.height / kSamples);
  std::vector<float> brightest;
  for (int y = 0; y < picture.height; y += dy) {
    const auto* in = reinterpret_cast<const float*>(picture.row(y));
    for (int x = 0; x < picture.width; x += dx) {
      const float most = std::max({in[3 * x], in[3 * x + 1], in[3 * x + 2]});
      if (std::isfinite(most)) brightest.push_back(most);
    }
  }
  if (brightest.empty()) return 1;
  const auto at = brightest.begin() + std::ptrdiff_t(kBelow * double(brightest.size() - 1));
  std::nth_element(brightest.begin(), at, brightest.end());
  return *at > 1 ? 1 / *at : 1;
}

Image<std::uint8_t> bytes_from(const Picture& picture, const Response& response, float scale) {
  const int count = 3 * picture.width;
  if (picture.type == PixelType::uint8) {
    Image<std::uint8_t> out;
    out.width = picture.width, out.height = picture.height;
    out.data.reserve(std::size_t(count) * std::size_t(picture.height));
    for (int y = 0; y < picture.height; ++y)
      out.data.insert(out.data.end(), picture.row(y), picture.row(y) + count);
    return out;
  }
  Image<std::uint8_t> out(picture.width, picture.height, 3);
  const ByteResponse table(response);
  for (int y = 0; y < picture.height; ++y) {
    std::uint8_t* to = out.row(y);
    if (picture.type == PixelType::uint16) {
      const auto* in = reinterpret_cast<const std::uint16_t*>(picture.row(y));
      for (int i = 0; i < count; ++i) to[i] = std::uint8_t((in[i] * 255u + 32767u) / 65535u);
    } else {
      const auto* in = reinterpret_cast<const float*>(picture.row(y));
      for (int i = 0; i < count; ++i) to[i] = table.encode(scale * in[i]);
    }
  }
  return out;
}

Image<std::uint8_t> grey_from(const Picture& picture, const Response& response) {
  const bool bytes = picture.type == PixelType::uint8;
  const Image<std::uint8_t> rgb =
      bytes ? Image<std::uint8_t>() : bytes_from(picture, response, scale_below_white(picture));
  Image<std::uint8_t> grey(picture.width, picture.height, 1);
  for (int y = 0; y < picture.height; ++y)
    luma(bytes ? picture.row(y) : rgb.row(y), picture.width, grey.row(y));
  return grey;
}

}  // namespace fastibl
