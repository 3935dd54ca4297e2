#include "demo/simulator/simulator_source.h"

#include <numbers>

#include "demo/simulator/hand_path.h"

namespace fastibl::demo {
namespace {

constexpr glm::vec3 kObject(0, 0, 0.06f);                   // where its centre is, metres
constexpr int kLightSize = 64;                              // texels along a face of the true map
constexpr double kFrontSteps[] = {1, 1.0 / 16, 1.0 / 256};  // exposures, used in turn
// Mean levels of what the cameras see, with white as 1, as cameras meter.
constexpr double kTableLevel = 0.2, kRoomLevel = 0.18;  // the paper of the board is brighter

// f and c apply to a width of 640 pixels. c: how far off the picture's middle the axis is.
Camera scaled(int width, int height, glm::dvec2 f, glm::dvec2 c) {
  const double s = width / 640.0;
  Camera camera;
  camera.width = width, camera.height = height;
  camera.fx = f.x * s, camera.fy = f.y * s;
  camera.cx = width / 2.0 + c.x * s, camera.cy = height / 2.0 + c.y * s;
  return camera;
}

}  // namespace

Rig default_rig(int width, int height) {
  Rig rig;
  rig.back = scaled(width, height, {522, 521.5}, {3.25, -2.5});
  rig.back.distortion = {0.06, -0.11, 0.0006, -0.0004, 0};
  rig.back.vignetting = {-0.30, 0.08};
  Camera front = scaled(width, height, {395.5, 395}, {-4.5, 1.75});
  front.distortion = {-0.08, 0.012, -0.0003, 0.0005, 0};
  front.vignetting = {-0.34, 0.09};
  rig.front = front;
  const Pose turn{rotation_from_vector({0, std::numbers::pi, 0}), {0, 0, 0}};
  rig.front_from_back =
      Pose{rotation_from_vector({0.012, -0.018, 0.007}), {0.021, 0.013, 0.004}} * turn;
  return rig;
}

SimulatorSource::SimulatorSource(int width, int height, bool true_poses)
    : rig_(default_rig(width, height)),
      back_(rig_.back),
      front_(*rig_.front),
      true_poses_(true_poses) {
  set_lamp(false);
  meter();
  start(0);
}

void SimulatorSource::set_lamp(bool on) {
  lamp_ = on;
  if (!rooms_[on]) rooms_[on] = std::make_shared<const Room>(on);
}

std::shared_ptr<const CubeMap> SimulatorSource::true_light() {
  if (!lights_[lamp_])
    lights_[lamp_] =
        std::make_shared<const CubeMap>(rooms_[lamp_]->environment(kObject, kLightSize));
  return lights_[lamp_];
}

// Sets exposures that stay as they are, so that switching the lamp on shows.
void SimulatorSource::meter() {
  const std::shared_ptr<const CubeMap> map = true_light();
  const CubeLevel& level = map->level_at_most(16);
  double sky = 0, count = 0;
  for (int f = 0; f < 6; ++f)
    for (int k = 0; k < level.size() * level.size(); ++k) {
      const int x = k % level.size(), y = k / level.size();
      if (texel_direction(f, x, y, level.size()).z <= 0) continue;
      const glm::vec3 texel = level.texel(f, x, y);
      sky += (texel.x + texel.y + texel.z) / 3, count += 1;
    }
  const glm::vec3 table = level.sample(glm::vec3(0, 0, -1));
  back_exposure_ = kTableLevel / double((table.x + table.y + table.z) / 3);
  front_exposure_ = kRoomLevel / (sky / count);
}

OwnedFrame SimulatorSource::make(int index, const Room& room) const {
  OwnedFrame frame;
  frame.time = index / fps();
  const Pose pose = hand_pose(frame.time);
  frame.back_exposure = back_exposure_;
  frame.front_exposure = front_exposure_ * kFrontSteps[index % 3];
  frame.back = back_.take(room, page_, pose, *frame.back_exposure, std::uint32_t(2 * index + 1));
  frame.front = front_.take(room, page_, rig_.front_from_back * pose, *frame.front_exposure,
                            std::uint32_t(2 * index + 2));
  if (true_poses_) frame.back_from_marker = pose;
  return frame;
}

// Makes a frame in a thread of its own, as a camera would, while the frame before is worked on.
void SimulatorSource::start(int index) {
  index_ = index;
  coming_ = std::async(std::launch::async,
                       [this, index, room = rooms_[lamp_]] { return make(index, *room); });
}

std::optional<OwnedFrame> SimulatorSource::next() {
  OwnedFrame frame = coming_.get();
  start(index_ + 1);
  return frame;
}

}  // namespace fastibl::demo
