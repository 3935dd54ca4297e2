// Decides which pictures of a rig go into the map, and with which exposures and poses.
#pragma once

#include <optional>

#include "fastibl/capture/capture.h"
#include "fastibl/render/frame.h"
#include "fastibl/render/rig_tracker.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/methods.h"

namespace fastibl {

class RigCapture {
 public:
  // front_ratio: by channel, the front camera's measure of light divided by the back camera's.
  // Throws std::invalid_argument where it is no such ratio, and what a Capture throws.
  RigCapture(Rig rig, CaptureOptions options, const glm::dvec3& front_ratio);

  Capture& map() { return map_; }
  const Capture& map() const { return map_; }

  // The pictures of a frame that there is time for.
  struct Turn {
    bool back = true, front = true;
  };
  // Whether any of these pictures is to go into the map. found: the frame's poses.
  bool wants(const Frame& frame, const FrameResult& found, const Turn& turn, CaptureMethod method,
             const RigTracker& tracker) const;
  // Adds them and sets `back_taken` and `front_taken` of the result. Where only the rotation is
  // known, the place is not: what was seen of the plane from the board's pose then stays as it was.
  // True where the older content of the map has another scale now.
  bool add(const Frame& frame, const Turn& turn, const RigTracker& tracker, FrameResult& result);

  // The pictures whose exposure the frame or the map tells: others cannot be compared.
  RigPictures pictures(const Frame& frame) const;
  void begin_single() { last_time_.reset(); }  // the next front picture is the paper's first

 private:
  void add_back(const Frame& frame, const RigTracker& tracker, FrameResult& result);
  void add_front(const Frame& frame, const RigTracker& tracker, FrameResult& result);
  bool is_single_exposure(const Frame& frame) const;
  // What the map last said about the exposures of a camera that does not tell them; used for its
  // next picture.
  struct ReadExposure {
    std::optional<double> last;
    bool steady = false;  // the same as before: no bracket
    void read(const Taken& taken);
    std::optional<double> next() const { return steady ? last : std::nullopt; }
  };

  Rig rig_;
  glm::dvec3 front_ratio_;
  Capture map_;
  ReadExposure read_back_, read_front_;
  int mended_ = 0;                                     // the map's last count
  std::optional<double> last_time_, single_exposure_;  // for the paper's single pictures
};

}  // namespace fastibl
