#include "fastibl/scene/picture.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "fastibl/core/check.h"
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

void check_picture(const Picture& picture) {
  check(!picture.empty() && picture.width > 0 && picture.height > 0,
        "the picture has no pixels: ", picture.width, " × ", picture.height,
        picture.empty() ? " without data" : "");
  const int bytes = picture.type == PixelType::uint8     ? 1
                    : picture.type == PixelType::uint16  ? 2
                    : picture.type == PixelType::float32 ? 4
                                                         : 0;
  check(bytes > 0, "pixels must be uint8, uint16 or float32, got type ", int(picture.type));
  check(std::abs(picture.stride()) >= picture.packed(), "rows of a picture of ", picture.width,
        " pixels must be at least ", picture.packed(), " bytes apart, got ", picture.stride());
  const auto address = reinterpret_cast<std::uintptr_t>(picture.data);
  check(address % std::uintptr_t(bytes) == 0 && picture.stride() % bytes == 0, "pixels of ",
        8 * bytes, " bit must lie at multiples of ", bytes, " bytes, got data at ", picture.data,
        " and rows ", picture.stride(), " bytes apart");
}

Image<float> linear_from(const Picture& picture, const Response& response) {
  check_picture(picture);
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
  check_picture(picture);
  if (picture.type != PixelType::float32) return 1;
  constexpr int kSamples = 200;    // along an edge
  constexpr double kBelow = 0.99;  // share of them that must stay below white
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
  Image<std::uint8_t> out;
  bytes_from(picture, response, out, scale);
  return out;
}

void bytes_from(const Picture& picture, const Response& response, Image<std::uint8_t>& out,
                float scale) {
  check_picture(picture);
  const int count = 3 * picture.width;
  const std::size_t size = std::size_t(count) * std::size_t(picture.height);
  out.width = picture.width, out.height = picture.height, out.channels = 3;
  if (picture.type == PixelType::uint8) {
    out.data.clear();
    out.data.reserve(size);
    for (int y = 0; y < picture.height; ++y)
      out.data.insert(out.data.end(), picture.row(y), picture.row(y) + count);
    return;
  }
  out.data.resize(size);
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
}

Image<std::uint8_t> grey_from(const Picture& picture, const Response& response) {
  check_picture(picture);
  const bool bytes = picture.type == PixelType::uint8;
  const Image<std::uint8_t> rgb =
      bytes ? Image<std::uint8_t>() : bytes_from(picture, response, scale_below_white(picture));
  Image<std::uint8_t> grey(picture.width, picture.height, 1);
  for (int y = 0; y < picture.height; ++y)
    luma(bytes ? picture.row(y) : rgb.row(y), picture.width, grey.row(y));
  return grey;
}

}  // namespace fastibl
