// Reads linear light at single pixels of an encoded picture: no pass over the whole picture is
// needed.
#pragma once

#include <array>
#include <cstdint>

#include "fastibl/core/image.h"
#include "fastibl/scene/response.h"

namespace fastibl {

// The response's table for one kind of picture. In colour pictures the three channels count alike:
// black and white differ equally in all of them, so that their mean has the least noise.
struct LightTable {
  LightTable(const Response& response, int channels);
  int channels;
  std::array<float, 256> value{};  // linear, divided by the number of channels
};

// Borrows both.
class LightReader {
 public:
  LightReader(ImageView<const std::uint8_t> picture, const LightTable& table)
      : picture_(picture), table_(table.value.data()) {}
  int width() const { return picture_.width; }
  int height() const { return picture_.height; }
  int channels() const { return picture_.channels; }

  // Reads `Count` pixels from (x, y) on, to the right or downwards.
  template <int Channels, int Count>
  void read(int x, int y, bool down, float* out) const {
    const std::uint8_t* p = picture_.row(y) + std::ptrdiff_t{x} * Channels;
    const std::ptrdiff_t step = down ? picture_.stride() : Channels;
    for (int k = 0; k < Count; ++k, p += step)
      out[k] = Channels == 1 ? table_[p[0]] : table_[p[0]] + table_[p[1]] + table_[p[2]];
  }
  // The code as it is stored; green of colour pictures.
  int code(int x, int y) const {
    return picture_.row(y)[std::ptrdiff_t{x} * picture_.channels + picture_.channels / 2];
  }

 private:
  ImageView<const std::uint8_t> picture_;
  const float* table_;
};

}  // namespace fastibl
