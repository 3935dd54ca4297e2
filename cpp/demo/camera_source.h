// Frames of one or two live cameras.
#pragma once

#include <opencv2/videoio.hpp>

#include "demo/frame_source.h"
#include "fastibl/core/clock.h"

namespace fastibl::demo {

class CameraSource final : public FrameSource {
 public:
  // back, front: OpenCV's camera numbers; front −1 for none. Throws std::invalid_argument for a
  // camera that does not open, or gives pictures of another size than the rig's.
  CameraSource(int back, int front, Rig rig);

  const Rig& rig() const override { return rig_; }
  std::optional<OwnedFrame> next() override;
  double fps() const override { return 30; }
  bool live() const override { return true; }

 private:
  Rig rig_;
  cv::VideoCapture back_, front_;
  Stopwatch clock_;
};

}  // namespace fastibl::demo
