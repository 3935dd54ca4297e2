#include "fastibl/tracking/light_pyramid.h"

namespace fastibl {
namespace {

constexpr float kClipped = 1e6f;           // instead of a clipped pixel's light; all means show it
constexpr float kBelowWhite = 1.5f / 255;  // encoded; what is brighter may have been clipped

}  // namespace

void LightPyramid::make_first(const Picture& picture, const Response& response) {
  Level& l = levels_[0];
  l.block = kFirstBlock;
  l.width = picture.width / kFirstBlock, l.height = picture.height / kFirstBlock;
  l.light.resize(std::size_t(l.width) * std::size_t(l.height));
  if (picture.type == PixelType::uint8) {
    for (int y = 0; y < l.height; ++y) {
      const std::uint8_t* above = picture.row(2 * y) + 1;
      const std::uint8_t* below = picture.row(2 * y + 1) + 1;
      float* out = l.light.data() + std::size_t(y) * std::size_t(l.width);
      for (int x = 0; x < l.width; ++x)
        out[x] = (table_[above[6 * x]] + table_[above[6 * x + 3]]) +
                 (table_[below[6 * x]] + table_[below[6 * x + 3]]);
    }
    return;
  }
  const Image<float> linear = linear_from(picture, response);
  const float white = response.decode(response.white() - kBelowWhite);
  const auto at = [&](int x, int y) {
    const float v = linear.pixel(x, y)[1];
    return 0.25f * (v < white ? v : kClipped);
  };
  for (int y = 0; y < l.height; ++y)
    for (int x = 0; x < l.width; ++x)
      l.light[std::size_t(y) * std::size_t(l.width) + std::size_t(x)] =
          (at(2 * x, 2 * y) + at(2 * x + 1, 2 * y)) +
          (at(2 * x, 2 * y + 1) + at(2 * x + 1, 2 * y + 1));
}

void LightPyramid::halve(int k) {
  const Level& from = levels_[std::size_t(k - 1)];
  Level& to = levels_[std::size_t(k)];
  to.block = 2 * from.block, to.width = from.width / 2, to.height = from.height / 2;
  to.light.resize(std::size_t(to.width) * std::size_t(to.height));
  for (int y = 0; y < to.height; ++y) {
    const float* above = from.light.data() + std::size_t(2 * y) * std::size_t(from.width);
    const float* below = above + from.width;
    float* out = to.light.data() + std::size_t(y) * std::size_t(to.width);
    for (int x = 0; x < to.width; ++x)
      out[x] = 0.25f * ((above[2 * x] + above[2 * x + 1]) + (below[2 * x] + below[2 * x + 1]));
  }
}

void LightPyramid::make(const Picture& picture, const Response& response) {
  if (!has_table_ || !(response == table_response_)) {
    const float white = response.white() - kBelowWhite;
    for (int code = 0; code < 256; ++code) {
      const float encoded = float(code) / 255;
      table_[std::size_t(code)] = 0.25f * (encoded < white ? response.decode(encoded) : kClipped);
    }
    table_response_ = response, has_table_ = true;
  }
  make_first(picture, response);
  for (int k = 1; k < kLevels; ++k) halve(k);
}

}  // namespace fastibl
