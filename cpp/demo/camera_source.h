// Frames of one or two live cameras.
#pragma once

#include <memory>

#include "demo/camera_reader.h"
#include "demo/frame_source.h"

namespace fastibl::demo {

// Goes on whatever happens to the cameras: one that was unplugged is opened again when it is back.
class CameraSource final : public FrameSource {
 public:
  // back, front: numbers, files or addresses; front empty for none. Throws as CameraReader does.
  CameraSource(const std::string& back, const std::string& front, Rig rig);

  const Rig& rig() const override { return rig_; }
  std::optional<OwnedFrame> next() override;
  bool ended() const override { return false; }
  double fps() const override { return 30; }
  bool live() const override { return true; }
  std::string trouble() const override;

 private:
  Rig rig_;
  Stopwatch clock_;
  std::unique_ptr<CameraReader> back_, front_;
};

}  // namespace fastibl::demo
