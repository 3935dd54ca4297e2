#include "fastibl/tracking/light_reader.h"

#include "fastibl/core/check.h"

namespace fastibl {

LightTable::LightTable(const Response& response, int count) : channels(count) {
  check(count == 1 || count == 3, "a picture must have 1 or 3 channels, got ", count);
  for (int code = 0; code < 256; ++code)
    value[std::size_t(code)] = response.decode(float(code) / 255) / float(count);
}

}  // namespace fastibl
