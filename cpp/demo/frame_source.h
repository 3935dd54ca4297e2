// Where frames come from: a recording or live cameras.
#pragma once

#include <memory>
#include <optional>

#include "fastibl/core/image.h"
#include "fastibl/render/session.h"

namespace fastibl::demo {

// A Frame that owns its pictures; RGB, empty where a camera has none.
struct OwnedFrame {
  double time = 0;
  Image<std::uint8_t> back, front;
  std::optional<double> back_exposure = 1, front_exposure = 1;
  std::optional<Pose> back_from_marker;

  Frame view() const;  // valid as long as this is
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual const Rig& rig() const = 0;
  // Nothing at the end. Trouble with a picture is told on stderr and ends the frames, or the
  // camera.
  virtual std::optional<OwnedFrame> next() = 0;
  virtual double fps() const = 0;  // of a video of these frames
  virtual bool live() const = 0;
};

inline Picture picture_of(const Image<std::uint8_t>& image) {
  if (image.empty()) return {};
  return {image.data.data(), PixelType::uint8, image.width, image.height,
          std::ptrdiff_t(image.width) * 3};
}

inline Frame OwnedFrame::view() const {
  return {
      time, picture_of(back), picture_of(front), back_exposure, front_exposure, back_from_marker,
      {}};
}

}  // namespace fastibl::demo
