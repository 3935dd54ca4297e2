// Sums of 2 × 2 decoded 8-bit pixels: the first and most expensive step of a picture's levels.
#pragma once

#include <array>
#include <cstdint>

#include "fastibl/scene/response.h"

namespace fastibl {

// Maps codes to linear values in 24 bits, with a count of clipped pixels in the bits above: one sum
// of four gives both.
struct CodeTable {
  static constexpr int kCountShift = 29;
  static constexpr float kUnit = 16777215;

  explicit CodeTable(const Response& response);
  std::array<std::uint32_t, 256> sums;
  std::array<std::uint8_t, 3 * 256> planes;  // the bytes of the value, for byte shuffles
  int clipped_code;

  static std::uint32_t count(std::uint32_t sum) { return sum >> kCountShift; }
};

// The numbers of clipped pixels of three channels are kept in one number, in this many bits each.
inline constexpr int kCountBits = 10;

// Writes means over `pairs` × 2 × 2 pixels of rows a and b as pixels of four floats, with the same
// bits on every processor. The fourth float is 1 where any pixel is clipped; `clipped` gets the
// numbers of those. scratch: four values a pair.
void decode_pairs(const CodeTable& table, const std::uint8_t* a, const std::uint8_t* b, int pairs,
                  std::uint32_t* scratch, float* pixels, std::uint32_t* clipped);

}  // namespace fastibl
