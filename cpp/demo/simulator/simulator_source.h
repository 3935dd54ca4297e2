// The simulator as a virtual camera: frames of a room with known light, no files needed.
#pragma once

#include <array>
#include <future>

#include "demo/frame_source.h"
#include "demo/simulator/eye.h"

namespace fastibl::demo {

// A telephone's two cameras: back 63 degrees wide, front 78, looking the opposite way.
Rig default_rig(int width, int height);

class SimulatorSource final : public FrameSource {
 public:
  // width, height: of the pictures, 4:3. true_poses: frames bring their poses. Endless.
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
  void set_lamp(bool on) override;  // from the frame after the next on: that one is being made

 private:
  OwnedFrame make(int index, const Room& room) const;
  void start(int index);
  void meter();

  Rig rig_;
  Board board_ = Board::default_board();
  Page page_{board_};
  Eye back_, front_;
  bool true_poses_, lamp_ = false;
  std::array<std::shared_ptr<const Room>, 2> rooms_;  // lamp off, on; made when first needed
  std::array<std::shared_ptr<const CubeMap>, 2> lights_;
  double back_exposure_ = 1, front_exposure_ = 1;
  int index_ = 0;                   // of the frame that is being made
  std::future<OwnedFrame> coming_;  // last: its thread reads the rest
};

}  // namespace fastibl::demo
