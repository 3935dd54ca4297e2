// Where frames come from: a recording, live cameras, or the simulator.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "fastibl/core/image.h"
#include "fastibl/render/session.h"

namespace fastibl::demo {

// A Frame that owns its pictures. They are RGB, and empty if a camera has none.
struct OwnedFrame {
  double time = 0;
  Image<std::uint8_t> back, front;
  std::optional<double> back_exposure = 1, front_exposure = 1;
  std::optional<Pose> back_from_marker;
  std::optional<glm::dmat3> attitude;

  Frame view() const;  // valid as long as this frame
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual const Rig& rig() const = 0;
  // The board in view, if the source knows it.
  virtual std::optional<Board> board() const { return std::nullopt; }
  // Returns nothing at the end, and also when no picture has come for a while. Trouble with a
  // picture is reported on stderr.
  virtual std::optional<OwnedFrame> next() = 0;
  virtual bool ended() const = 0;                     // for good
  virtual double fps() const = 0;                     // for a video of these frames
  virtual bool live() const = 0;                      // frames come at times of their own
  virtual std::string trouble() const { return {}; }  // lasting trouble, told to people

  // The place's true light as the object sees it, if the source knows it; otherwise null.
  virtual std::shared_ptr<const CubeMap> true_light() { return nullptr; }
  virtual bool has_lamp() const { return false; }
  virtual bool lamp() const { return false; }
  virtual void set_lamp(bool) {}
};

inline Picture picture_of(const Image<std::uint8_t>& image) {
  if (image.empty()) return {};
  return {image.data.data(), PixelType::uint8, image.width, image.height,
          std::ptrdiff_t(image.width) * 3};
}

inline Frame OwnedFrame::view() const {
  Frame frame;
  frame.time = time;
  frame.back = picture_of(back), frame.front = picture_of(front);
  frame.back_exposure = back_exposure, frame.front_exposure = front_exposure;
  frame.back_from_marker = back_from_marker;
  frame.attitude = attitude;
  return frame;
}

}  // namespace fastibl::demo
