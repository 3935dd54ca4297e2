#include "fastibl/scene/pixel_reader.h"

#include <algorithm>

#include "fastibl/scene/cube_map.h"

namespace fastibl {
namespace {

template <class Value>
const Value* pixel_of(const Picture& picture, int x, int y) {
  return reinterpret_cast<const Value*>(picture.row(y)) + 3 * x;
}

}  // namespace

glm::vec3 PixelReader::linear(int x, int y) const {
  switch (picture_.type) {
    case PixelType::uint8: {
      const std::uint8_t* p = pixel_of<std::uint8_t>(picture_, x, y);
      return {bytes_.decode(p[0]), bytes_.decode(p[1]), bytes_.decode(p[2])};
    }
    case PixelType::uint16: {
      const std::uint16_t* p = pixel_of<std::uint16_t>(picture_, x, y);
      return {response_.decode(float(p[0]) / 65535), response_.decode(float(p[1]) / 65535),
              response_.decode(float(p[2]) / 65535)};
    }
    default: {
      const float* p = pixel_of<float>(picture_, x, y);
      CleaningStatistics ignored;
      return {clean_radiance(p[0], ignored), clean_radiance(p[1], ignored),
              clean_radiance(p[2], ignored)};
    }
  }
}

PixelReader::Block PixelReader::block(int x, int y, int size, int step) const {
  const int code = bytes_.clipped_code();
  Block out;
  int count = 0;
  for (int v = y; v < y + size; v += step) {
    if (picture_.type == PixelType::uint8) {
      const std::uint8_t* p = pixel_of<std::uint8_t>(picture_, x, v);
      for (int u = 0; u < size; u += step, ++count, p += 3 * step) {
        for (int c = 0; c < 3; ++c) out.linear[c] += bytes_.decode(p[c]);
        out.clipped |= std::max({p[0], p[1], p[2]}) >= code;
      }
    } else {
      for (int u = x; u < x + size; u += step, ++count)
        out.linear += linear(u, v), out.clipped |= clipped(u, v);
    }
  }
  out.linear /= float(count);
  return out;
}

bool PixelReader::clipped(int x, int y) const {
  const int code = bytes_.clipped_code();
  const auto any = [](const auto* p, int limit) {
    return p[0] >= limit || p[1] >= limit || p[2] >= limit;
  };
  switch (picture_.type) {
    case PixelType::uint8:
      return any(pixel_of<std::uint8_t>(picture_, x, y), code);
    case PixelType::uint16:
      return any(pixel_of<std::uint16_t>(picture_, x, y), 257 * code);
    default:
      return false;
  }
}

}  // namespace fastibl
