#include "fastibl/core/image.h"

#include "fastibl/core/check.h"

namespace fastibl::checks {

void rows_apart(const char* which, std::ptrdiff_t packed, std::ptrdiff_t stride) {
  check(std::abs(stride) >= packed, "rows of ", which, ", ", packed,
        " values each, must be at least that far apart, got ", stride);
}

void not_negative(int width, int height, int channels) {
  check(width >= 0 && height >= 0 && channels >= 0,
        "the size of a picture must not be negative, got ", width, " × ", height, " with ",
        channels, " channels");
}

void as_many_values(int width, int height, int channels, std::size_t values) {
  not_negative(width, height, channels);
  const std::size_t needed = std::size_t(width) * std::size_t(height) * std::size_t(channels);
  check(values == needed, "a picture of ", width, " × ", height, " with ", channels,
        " channels needs ", needed, " values, got ", values);
}

}  // namespace fastibl::checks
