// The function that finds tags in a picture. The tracker gets it from outside, so that neither it
// nor a Session names the library behind it.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

struct Detection {
  std::vector<DetectedTag>
      tags;                   // in fastibl's pixel convention, corners in the order of Tag::corners
  std::optional<Pose> start;  // camera_from_marker to start from, where the detector has one
};

// grey: one channel, encoded values, the camera's size.
using Detector = std::function<Detection(ImageView<const std::uint8_t> grey, const Board& board,
                                         const Camera& camera)>;

}  // namespace fastibl
