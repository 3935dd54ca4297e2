// One live camera, read in a thread of its own, so that its newest picture is at hand however long
// other work takes.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <opencv2/videoio.hpp>
#include <optional>
#include <string>
#include <thread>

#include "fastibl/core/clock.h"
#include "fastibl/scene/camera.h"

namespace fastibl::demo {

class CameraReader {
 public:
  // place: OpenCV's camera number, a file, or an address. clock: gives the pictures' times; must
  // outlive this reader. Throws std::invalid_argument for a camera that does not open, or whose
  // pictures have another size than `camera`.
  CameraReader(std::string place, const Camera& camera, std::string name, const Stopwatch& clock);
  ~CameraReader();

  struct Shot {
    cv::Mat picture;  // BGR
    double time = 0;  // seconds, when it was taken
  };
  // The newest picture, unless it was returned before; waits for one for at most `seconds`.
  std::optional<Shot> newest(double seconds);
  // Whether the camera is lost; it is opened again as soon as it is there.
  bool lost() const { return lost_; }
  const std::string& name() const { return name_; }
  // Multiplier of radiance: 1 if the camera holds its exposure, otherwise unknown. A file's
  // exposure counts as held.
  std::optional<double> exposure() const { return held_ ? std::optional(1.0) : std::nullopt; }

 private:
  void open();  // throws std::invalid_argument
  void hold_exposure();
  void run();
  void reopen();

  std::string place_;
  Camera camera_;
  std::string name_;
  const Stopwatch& clock_;
  cv::VideoCapture capture_;
  double period_ = 0;  // seconds between pictures of a file, which could be read faster
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Shot> shot_;
  std::atomic<bool> lost_ = false, held_ = false;
  bool told_ = false;  // the user was told that its exposure is not known
  bool closing_ = false;
  std::thread thread_;
};

}  // namespace fastibl::demo
