#include "fastibl/render/frame.h"

#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

void check_picture(const Picture& picture, const Camera& camera, const char* which) {
  if (picture.empty()) return;
  check(picture.width == camera.width && picture.height == camera.height, "the ", which,
        " picture must be the camera's ", camera.width, " × ", camera.height, ", got ",
        picture.width, " × ", picture.height);
  fastibl::check_picture(picture);
}

}  // namespace

void check_frame(const Frame& frame, const Rig& rig) {
  check_picture(frame.back, rig.back, "back");
  if (rig.front) check_picture(frame.front, *rig.front, "front");
  check(frame.front.empty() || rig.front, "a front picture came, but the rig has no front camera");
  for (const std::optional<double>& exposure : {frame.back_exposure, frame.front_exposure})
    check(!exposure || (*exposure > 0 && std::isfinite(*exposure)),
          "exposures must be positive and finite, got ", exposure.value_or(0));
  for (const std::optional<Pose>& pose : {frame.back_from_marker, frame.back_last_row})
    if (pose) pose->validate();
  check(!frame.attitude || is_rotation(*frame.attitude, kAttitude),
        "a frame's attitude must be a rotation");
  check(!frame.back.empty() || !frame.front.empty() || frame.back_from_marker,
        "a frame needs a picture or a pose");
  check(!frame.back_last_row || (frame.back_from_marker && rig.back.readout > 0),
        "a pose of the last row needs one of the first and a back camera with a readout, got a "
        "readout of ",
        rig.back.readout, " s");
  check(std::isfinite(frame.time), "a frame's time must be finite seconds, got ", frame.time);
}

}  // namespace fastibl
