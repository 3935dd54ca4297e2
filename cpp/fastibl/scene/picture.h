// A camera picture as it arrives: RGB, encoded (8 or 16 bit) or linear (float).
#pragma once

#include <cstdint>

#include "fastibl/core/image.h"
#include "fastibl/scene/response.h"

namespace fastibl {

enum class PixelType { uint8, uint16, float32 };

// Borrowed pixels with three interleaved channels. 16-bit pixels lie at even addresses, float
// pixels at multiples of four; the same must hold for `data` and row_bytes.
struct Picture {
  const void* data = nullptr;
  PixelType type = PixelType::uint8;
  int width = 0, height = 0;
  std::ptrdiff_t row_bytes = 0;  // from row to row, negative for upwards; 0: rows are packed

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

// Throws std::invalid_argument for a picture that cannot be read: no pixels, a type that is none of
// these, rows closer together than their length, or pixels at other addresses. All code that reads
// a picture calls this first.
void check_picture(const Picture& picture);

// Linear values (exposure × gain × vignetting × radiance). Float pictures are cleaned as maps are:
// NaN and negative values to 0, at most 1e9.
Image<float> linear_from(const Picture& picture, const Response& response);
// The factor, at most 1, by which to multiply a float picture, which may go far beyond white, so
// that no more than its brightest hundredth is white.
float scale_below_white(const Picture& picture);
// 8-bit RGB for a person to look at: 8-bit input is unchanged; other input is encoded with the
// response, float after multiplication by `scale`.
Image<std::uint8_t> bytes_from(const Picture& picture, const Response& response, float scale = 1);
// The same into an image, whose memory is used again.
void bytes_from(const Picture& picture, const Response& response, Image<std::uint8_t>& out,
                float scale = 1);
// 8-bit grey for detection, from the encoded values (Rec. 601 luma); float is first scaled below
// white.
Image<std::uint8_t> grey_from(const Picture& picture, const Response& response);

}  // namespace fastibl
