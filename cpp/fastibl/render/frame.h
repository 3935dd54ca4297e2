// What a session takes for one moment, and what it makes of it.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fastibl/capture/capture.h"
#include "fastibl/core/image.h"
#include "fastibl/core/pose.h"
#include "fastibl/plan/pass.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/picture.h"
#include "fastibl/tracking/rotation_tracker.h"
#include "fastibl/tracking/tracker.h"

namespace fastibl {

// What the cameras give at one moment. Pictures are borrowed for the call.
struct Frame {
  double time = 0;  // seconds, not decreasing
  Picture back, front;
  std::optional<double> back_exposure = 1, front_exposure = 1;  // nothing where unknown
  // Given instead of tracking it. For a rolling shutter: of the first row.
  std::optional<Pose> back_from_marker;
  // May be given with back_from_marker where the back camera has a readout. Where it is not known,
  // it is estimated from the poses before.
  std::optional<Pose> back_last_row;
  // Rotation of the back camera from a frame at rest, as a gyroscope tells it; any frame at rest
  // will do that is the same for all frames. Predicts the pose, also while the board is out of
  // view.
  std::optional<glm::dmat3> attitude;
};

constexpr double kAttitude = 1e-3;  // by how much Frame::attitude may differ from a rotation

// Throws std::invalid_argument, which says what is wrong, for a frame that no rig of these cameras
// can have given.
void check_frame(const Frame& frame, const Rig& rig);

struct FrameResult {
  // RGB; RGBA with straight alpha where neither the frame nor a texture (see GlRenderer) gives a
  // back picture. Without SessionOptions::read_back there is none: its width is 0.
  Image<std::uint8_t> image;
  // Nothing where the board is not seen; `image` is then the back picture, as it is where nothing
  // of the scene is in view.
  std::optional<Pose> back_from_marker;
  std::optional<Pose> back_last_row;  // for a rolling shutter, where its motion is known
  std::optional<Tracked> tracked;     // where the pose was tracked, not given
  // How the map took the pictures, where they were added to it.
  std::optional<Taken> back_taken, front_taken;
  // What the surroundings tell where the board is out of view. With it, pictures may be captured
  // into the map; nothing is drawn.
  std::optional<Turned> turned;
  bool board_moved = false;  // by hand; the map was turned to where the board lies now
  std::shared_ptr<const Environment> environment;
  std::shared_ptr<const Lighting> lighting;
  std::vector<PassId> passes;             // those that ran
  std::map<std::string, double> timings;  // seconds, by pass, and "total"
  // Relative error of the irradiance, capture and method together; 1 before there is any light.
  double predicted_error = 1;
};

}  // namespace fastibl
