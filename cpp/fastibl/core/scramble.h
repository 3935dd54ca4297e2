// Numbers that look random, the same everywhere.
#pragma once

#include <cstdint>

namespace fastibl {

// Mixer of MurmurHash3: neighbouring numbers become unlike ones.
inline std::uint32_t scramble(std::uint32_t h) {
  h ^= h >> 16, h *= 0x85ebca6bu;
  h ^= h >> 13, h *= 0xc2b2ae35u;
  return h ^ h >> 16;
}

}  // namespace fastibl
