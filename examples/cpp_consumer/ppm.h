// Writes a picture as PPM; where it is transparent, over white.
#pragma once

#include <fastibl/core/image.h>

#include <cstdio>
#include <stdexcept>
#include <string>

inline void write_ppm(const std::string& path, const fastibl::Image<std::uint8_t>& image) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (!file) throw std::runtime_error("cannot write " + path);
  std::fprintf(file, "P6\n%d %d\n255\n", image.width, image.height);
  const std::size_t channels = std::size_t(image.channels);
  for (std::size_t i = 0; i < image.data.size(); i += channels)
    for (std::size_t c = 0; c < 3; ++c) {
      const int alpha = channels == 4 ? image.data[i + 3] : 255;
      std::fputc((image.data[i + c] * alpha + 255 * (255 - alpha)) / 255, file);
    }
  if (std::fclose(file) != 0) throw std::runtime_error("cannot write " + path);
}
