// The simulator as a virtual camera: frames of a room with known light; no files are needed.
#pragma once

#include <array>
#include <future>

#include "demo/frame_source.h"
#include "demo/simulator/eye.h"

namespace fastibl::demo {

// A telephone's two cameras: the back one 63 degrees wide, the front one 78 and looking the
// opposite way.
Rig default_rig(int width, int height);

class SimulatorSource final : public FrameSource {
 public:
  // width, height: of the pictures, 4:3. true_poses: whether frames bring their poses. The frames
  // never end.
  SimulatorSource(int width, int height, bool true_poses);

  const Rig& rig() const override { return rig_; }
  std::optional<Board> board() const override { return board_; }
  std::optional<OwnedFrame> next() override;
  bool ended() const override { return false; }
  double fps() const override { return 30; }
  bool live() const override { return false; }

  std::shared_ptr<const CubeMap> true_light() override;
  bool has_lamp() const override { return true; }
  bool lamp() const override { return lamp_; }
  void set_lamp(bool on) override;  // from the frame after the next: that one is in the making

 private:
  OwnedFrame make(int index, const Room& room) const;
  void start(int index);
  void meter();

  Rig rig_;
  Board board_ = Board::default_board();
  Page page_{board_};
  Eye back_, front_;
  bool true_poses_, lamp_ = false;
  std::array<std::shared_ptr<const Room>, 2> rooms_;  // lamp off, lamp on; made when first needed
  std::array<std::shared_ptr<const CubeMap>, 2> lights_;
  double back_exposure_ = 1, front_exposure_ = 1;
  int index_ = 0;                   // the frame that is being made
  std::future<OwnedFrame> coming_;  // last member: its thread reads the others
};

}  // namespace fastibl::demo
