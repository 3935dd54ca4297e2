// A camera picture as it arrives: RGB, encoded (8 or 16 bit) or linear (float).
#pragma once

#include <cstdint>

#include "fastibl/core/image.h"
#include "fastibl/scene/response.h"

namespace fastibl {

enum class PixelType { uint8, uint16, float32 };

// Borrowed; three interleaved channels. Pixels of 16 bit lie at even addresses, of float at
// multiples of four: the data begin at one, and row_bytes is one.
struct Picture {
  const void* data = nullptr;
  PixelType type = PixelType::uint8;
  int width = 0, height = 0;
  std::ptrdiff_t row_bytes = 0;  // from row to row, below 0 upwards; 0: they are packed

  bool empty() const { return data == nullptr; }
  std::ptrdiff_t packed() const {  // bytes of a row
    return std::ptrdiff_t{width} * (type == PixelType::uint8    ? 3
                                    : type == PixelType::uint16 ? 6
                                                                : 12);
  }
  std::ptrdiff_t stride() const { return row_bytes != 0 ? row_bytes : packed(); }
  const std::uint8_t* row(int y) const {
    return static_cast<const std::uint8_t*>(data) + y * stride();
  }
};

// Throws std::invalid_argument for what cannot be read: no pixels, a type that is none of these,
// rows that lie closer than their pixels, or pixels at other addresses. All that reads a picture
// begins with it.
void check_picture(const Picture& picture);

// Linear values (exposure × gain × vignetting × radiance). Float pictures are cleaned as maps are:
// NaN and negative values to 0, at most 1e9.
Image<float> linear_from(const Picture& picture, const Response& response);
// At most 1: by which a float picture, which may go far beyond white, is to be multiplied so that
// no more than its brightest hundredth is white.
float scale_below_white(const Picture& picture);
// 8-bit RGB as a person sees it: 8-bit input unchanged, else encoded with the response, float after
// it was multiplied by `scale`.
Image<std::uint8_t> bytes_from(const Picture& picture, const Response& response, float scale = 1);
// 8-bit grey for detection, from the encoded values (Rec. 601 luma), of float scaled below white.
Image<std::uint8_t> grey_from(const Picture& picture, const Response& response);

}  // namespace fastibl
