#include "demo/camera_source.h"

#include <iostream>

#include "demo/pixels.h"

namespace fastibl::demo {
namespace {

// Pictures that a camera gets to settle its exposure before it is held: radiance is compared
// between pictures, so an exposure that changes unseen would change the light.
constexpr int kSettling = 15;

cv::VideoCapture open(int number, const Camera& camera, const char* name) {
  cv::VideoCapture capture(number);
  check(capture.isOpened(), "the ", name, " camera ", number, " does not open");
  capture.set(cv::CAP_PROP_FRAME_WIDTH, camera.width);
  capture.set(cv::CAP_PROP_FRAME_HEIGHT, camera.height);
  capture.set(cv::CAP_PROP_BUFFERSIZE, 1);  // no old pictures
  cv::Mat picture;
  for (int k = 0; k < kSettling; ++k)
    check(capture.read(picture), "the ", name, " camera ", number, " gives no pictures");
  check(picture.cols == camera.width && picture.rows == camera.height, "the ", name,
        " camera is calibrated for ", camera.width, " × ", camera.height, ", but gives ",
        picture.cols, " × ", picture.rows);
  const double settled = capture.get(cv::CAP_PROP_EXPOSURE);
  const bool held = capture.set(cv::CAP_PROP_AUTO_EXPOSURE, 1) &&  // V4L2's manual mode
                    capture.set(cv::CAP_PROP_EXPOSURE, settled);
  const bool white = capture.set(cv::CAP_PROP_AUTO_WB, 0);
  if (!held || !white)
    std::cerr << "fastibl-demo: the " << name << " camera cannot hold its "
              << (held ? "white balance" : "exposure") << "; measured light will drift with it\n";
  return capture;
}

}  // namespace

CameraSource::CameraSource(int back, int front, Rig rig) : rig_(std::move(rig)) {
  check(front < 0 || rig_.front, "a front camera was asked for, but the rig has none");
  back_ = open(back, rig_.back, "back");
  if (front >= 0) front_ = open(front, *rig_.front, "front");
}

std::optional<OwnedFrame> CameraSource::next() {
  // Both are grabbed before either is decoded, so that they are of one moment.
  if (!back_.grab()) {
    std::cerr << "fastibl-demo: the back camera gives no more pictures\n";
    return std::nullopt;
  }
  OwnedFrame frame;
  frame.time = clock_.seconds();
  cv::Mat picture;
  if (front_.isOpened()) {
    if (front_.grab() && front_.retrieve(picture)) {
      frame.front = rgb_from(picture);
    } else {
      std::cerr << "fastibl-demo: the front camera gives no more pictures; going on without it\n";
      front_.release();
    }
  }
  if (!back_.retrieve(picture)) return std::nullopt;
  frame.back = rgb_from(picture);
  return frame;
}

}  // namespace fastibl::demo
