// What a headless run writes: a VP9 video, a folder of PNGs, or one PNG.
#pragma once

#include <filesystem>
#include <opencv2/videoio.hpp>
#include <string_view>

#include "fastibl/core/image.h"

namespace fastibl::demo {

class Output {
 public:
  // path: .webm for a video; .png for the last picture; anything else is a folder, which is made if
  // it is missing; empty writes nothing. Throws std::invalid_argument for another file ending, or a
  // folder that cannot be made.
  Output(std::filesystem::path path, double fps);
  void add(const Image<std::uint8_t>& picture);  // RGB or RGBA
  void finish();  // throws std::runtime_error if something cannot be written

 private:
  std::filesystem::path path_;
  double fps_;
  int count_ = 0;
  cv::VideoWriter video_;
  Image<std::uint8_t> last_;
};

// Throws std::invalid_argument, naming the option, if the file's folder does not exist.
void check_folder_of(const std::filesystem::path& path, std::string_view option);
// These throw std::runtime_error, also when the disk is full.
void write_file(const std::filesystem::path& path, const char* data, std::size_t count);
void write_png(const std::filesystem::path& path, const Image<std::uint8_t>& picture);

}  // namespace fastibl::demo
