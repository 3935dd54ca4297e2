// Which pictures of a rig go into the map, and with which exposures and poses.
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
  // front_ratio: by channel, what the front camera makes of light by what the back one makes of it.
  // Throws std::invalid_argument where it is none, and what a Capture throws.
  RigCapture(Rig rig, CaptureOptions options, const glm::dvec3& front_ratio);

  Capture& map() { return map_; }
  const Capture& map() const { return map_; }

  // Of a frame's pictures, those that there is time for.
  struct Turn {
    bool back = true, front = true;
  };
  // Whether any of these is to go into the map. found: the frame's poses.
  bool wants(const Frame& frame, const FrameResult& found, const Turn& turn, CaptureMethod method,
             const RigTracker& tracker) const;
  // Adds them: `back_taken` and `front_taken` of the result. Of what only turned, the place is not
  // known: the plane that was seen from the board's pose stays as it was. True where what was in
  // the map before has another scale now.
  bool add(const Frame& frame, const Turn& turn, const RigTracker& tracker, FrameResult& result);

  // Those of known exposure, as the frame or the map tells it: others cannot be compared.
  RigPictures pictures(const Frame& frame) const;
  void begin_single() { last_time_.reset(); }  // the next front picture is the paper's first

 private:
  void add_back(const Frame& frame, const RigTracker& tracker, FrameResult& result);
  void add_front(const Frame& frame, const RigTracker& tracker, FrameResult& result);
  bool is_single_exposure(const Frame& frame) const;
  // What the map last said of the exposures of a camera that tells none, for its next picture.
  struct ReadExposure {
    std::optional<double> last;
    bool steady = false;  // as that before it: no bracket
    void read(const Taken& taken);
    std::optional<double> next() const { return steady ? last : std::nullopt; }
  };

  Rig rig_;
  glm::dvec3 front_ratio_;
  Capture map_;
  ReadExposure read_back_, read_front_;
  int mended_ = 0;                                     // as the map had it
  std::optional<double> last_time_, single_exposure_;  // of the paper's single pictures
};

}  // namespace fastibl
