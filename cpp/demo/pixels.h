// Converts between OpenCV's pictures (BGR) and ours (RGB).
#pragma once

#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "fastibl/core/image.h"

namespace fastibl::demo {

inline Image<std::uint8_t> rgb_from(const cv::Mat& bgr) {
  Image<std::uint8_t> image(bgr.cols, bgr.rows, 3);
  cv::Mat rgb(bgr.rows, bgr.cols, CV_8UC3, image.data.data());
  cv::cvtColor(bgr, rgb, cv::COLOR_BGR2RGB);
  return image;
}

// image: 3 or 4 channels.
inline cv::Mat bgr_from(const Image<std::uint8_t>& image) {
  const bool alpha = image.channels == 4;
  const cv::Mat rgb(image.height, image.width, alpha ? CV_8UC4 : CV_8UC3,
                    const_cast<std::uint8_t*>(image.data.data()));  // read only
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, alpha ? cv::COLOR_RGBA2BGRA : cv::COLOR_RGB2BGR);
  return bgr;
}

}  // namespace fastibl::demo
