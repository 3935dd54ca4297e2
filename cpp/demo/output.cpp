#include "demo/output.h"

#include <cstdio>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "demo/pixels.h"
#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

namespace fs = std::filesystem;

}  // namespace

void check_folder_of(const fs::path& path, std::string_view option) {
  const fs::path parent = path.parent_path();
  check(parent.empty() || fs::is_directory(parent), option, ": there is no folder ",
        parent.string());
}

void write_file(const fs::path& path, const char* data, std::size_t count) {
  std::ofstream file(path, std::ios::binary);
  file.write(data, std::streamsize(count));
  file.close();
  if (file) return;
  const fs::path parent = path.parent_path();
  const bool folder = parent.empty() || fs::is_directory(parent);
  throw std::runtime_error("could not write " + path.string() +
                           (folder ? "; is the disk full?" : ": its folder is not there"));
}

void write_png(const fs::path& path, const Image<std::uint8_t>& picture) {
  std::vector<unsigned char> bytes;
  if (!cv::imencode(".png", bgr_from(picture), bytes, {cv::IMWRITE_PNG_COMPRESSION, 1}))
    throw std::runtime_error("could not encode " + path.string());
  write_file(path, reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

Output::Output(fs::path path, double fps) : path_(std::move(path)), fps_(fps) {
  if (path_.empty() || path_.extension() == ".webm" || path_.extension() == ".png") {
    check_folder_of(path_, "--out");
    return;
  }
  check(!path_.has_extension() || fs::is_directory(path_),
        "--out: expected a .webm, a .png or a folder, got ", path_.string());
  std::error_code error;
  fs::create_directories(path_, error);
  check(!error, "--out: the folder ", path_.string(), " cannot be made: ", error.message());
}

void Output::add(const Image<std::uint8_t>& picture) {
  if (path_.empty()) return;
  if (path_.extension() == ".png") {
    last_ = picture;
  } else if (path_.extension() == ".webm") {
    cv::Mat bgr = bgr_from(picture);
    if (bgr.channels() == 4) cv::cvtColor(bgr, bgr, cv::COLOR_BGRA2BGR);
    if (!video_.isOpened()) {
      if (!std::ofstream(path_)) throw std::runtime_error("could not write " + path_.string());
      if (!video_.open(path_.string(), cv::VideoWriter::fourcc('V', 'P', '9', '0'), fps_,
                       bgr.size()))
        throw std::runtime_error("this OpenCV cannot write VP9 video to " + path_.string() +
                                 "; write to a folder instead");
    }
    video_.write(bgr);
  } else {
    char name[16];
    std::snprintf(name, sizeof name, "%05d.png", count_);
    write_png(path_ / name, picture);
  }
  ++count_;
}

void Output::finish() {
  if (path_.extension() == ".png" && !last_.empty()) write_png(path_, last_);
  if (!video_.isOpened()) return;
  video_.release();  // which does not report a full disk
  cv::VideoCapture written(path_.string());
  if (!written.isOpened() || !written.grab())
    throw std::runtime_error("could not write " + path_.string() + "; is the disk full?");
}

}  // namespace fastibl::demo
