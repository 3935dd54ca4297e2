// What a session is given of a moment, and what it makes of it.
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

// One moment of the cameras. Pictures are borrowed for the call.
struct Frame {
  double time = 0;  // seconds, not decreasing
  Picture back, front;
  std::optional<double> back_exposure = 1, front_exposure = 1;  // nothing where not known
  // Skips tracking. Of a rolling shutter: of the first row.
  std::optional<Pose> back_from_marker;
  // With it, where the back camera has a readout and the pose of its last row is known; else that
  // comes from the poses before.
  std::optional<Pose> back_last_row;
  // Of the back camera, as a gyroscope tells, from a frame at rest, whichever, that is the same for
  // all frames: predicts the pose, and goes on while the board is out of view.
  std::optional<glm::dmat3> attitude;
};

constexpr double kAttitude = 1e-3;  // by which Frame::attitude may not be a rotation

// Throws std::invalid_argument, with what is wrong, for a frame that no rig of these cameras can
// have given.
void check_frame(const Frame& frame, const Rig& rig);

struct FrameResult {
  Image<std::uint8_t> image;  // RGB; RGBA with straight alpha where the frame has no back picture
  // Nothing where the board is not seen: the picture is the back picture.
  std::optional<Pose> back_from_marker;
  std::optional<Pose> back_last_row;  // of a rolling shutter, where its motion is known
  std::optional<Tracked> tracked;     // where it was tracked, not given
  // How the pictures went into the map, where they did.
  std::optional<Taken> back_taken, front_taken;
  // Where the board is out of view: what the surroundings tell. The map may be captured with it;
  // nothing is drawn.
  std::optional<Turned> turned;
  bool board_moved = false;  // by hand; the map was turned to where it lies now
  std::shared_ptr<const Environment> environment;
  std::shared_ptr<const Lighting> lighting;
  std::vector<PassId> passes;             // that ran
  std::map<std::string, double> timings;  // seconds, by pass, and "total"
  // Relative, of the irradiance: capture and method together; 1 before there is any light.
  double predicted_error = 1;
};

}  // namespace fastibl
