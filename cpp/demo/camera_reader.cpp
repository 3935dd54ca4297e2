#include "demo/camera_reader.h"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <utility>

#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

// Number of pictures that a camera gets to settle its exposure before it is held. Radiance is
// compared between pictures, so an exposure that changes unnoticed would change the light.
constexpr int kSettling = 15;
constexpr int kNetwork = 5000;  // milliseconds in which a camera on the network must answer
constexpr double kAgain = 0.5;  // seconds between tries to open a camera that was lost

bool is_number(const std::string& place) {
  return !place.empty() && place.size() < 5 &&
         std::all_of(place.begin(), place.end(), [](unsigned char c) { return std::isdigit(c); });
}

}  // namespace

CameraReader::CameraReader(std::string place, const Camera& camera, std::string name,
                           const Stopwatch& clock)
    : place_(std::move(place)), camera_(camera), name_(std::move(name)), clock_(clock) {
  open();
  thread_ = std::thread([this] { run(); });
}

CameraReader::~CameraReader() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void CameraReader::open() {
  if (is_number(place_))
    capture_.open(std::stoi(place_));
  else if (place_.find("://") != std::string::npos)  // gives up in less than half a minute
    capture_.open(
        place_, cv::CAP_FFMPEG,
        {cv::CAP_PROP_OPEN_TIMEOUT_MSEC, kNetwork, cv::CAP_PROP_READ_TIMEOUT_MSEC, kNetwork});
  else
    capture_.open(place_);
  check(capture_.isOpened(), "the ", name_, " camera ", place_, " does not open");
  cv::Mat picture;
  const bool file = std::filesystem::is_regular_file(place_);
  if (file) {
    capture_.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);  // pictures as the sensor took them
  } else {
    capture_.set(cv::CAP_PROP_FRAME_WIDTH, camera_.width);
    capture_.set(cv::CAP_PROP_FRAME_HEIGHT, camera_.height);
    capture_.set(cv::CAP_PROP_BUFFERSIZE, 1);  // no old pictures
  }
  for (int k = 0; k < (is_number(place_) ? kSettling : 1); ++k)
    check(capture_.read(picture), "the ", name_, " camera ", place_, " gives no pictures");
  check(picture.cols == camera_.width && picture.rows == camera_.height, "the ", name_,
        " camera is calibrated for ", camera_.width, " × ", camera_.height, ", but gives ",
        picture.cols, " × ", picture.rows);
  held_ = file;
  if (is_number(place_))
    hold_exposure();
  else if (!file && !told_)
    std::cerr << "fastibl-demo: the " << name_ << " camera does not tell its exposure; light is "
              << "measured by what its pictures share\n",
        told_ = true;
  const double fps = file ? capture_.get(cv::CAP_PROP_FPS) : 0;
  period_ = fps > 0 ? 1 / fps : 0;
}

void CameraReader::hold_exposure() {
  const double settled = capture_.get(cv::CAP_PROP_EXPOSURE);
  const bool held = capture_.set(cv::CAP_PROP_AUTO_EXPOSURE, 1) &&  // V4L2's manual mode
                    capture_.set(cv::CAP_PROP_EXPOSURE, settled);
  const bool white = capture_.set(cv::CAP_PROP_AUTO_WB, 0);
  held_ = held;
  if (!held || !white)
    std::cerr << "fastibl-demo: the " << name_ << " camera cannot hold its "
              << (held ? "white balance" : "exposure") << "; measured light will drift with it\n";
}

void CameraReader::run() {
  double due = clock_.seconds();
  while (true) {
    Shot shot;
    bool read = false;
    try {
      read = capture_.grab();
      shot.time = clock_.seconds();
      read = read && capture_.retrieve(shot.picture) && shot.picture.cols == camera_.width &&
             shot.picture.rows == camera_.height;
    } catch (const cv::Exception&) {
      read = false;
    }
    std::unique_lock lock(mutex_);
    if (closing_) return;
    if (read) {
      shot_ = std::move(shot);
      changed_.notify_all();
      due += period_;
      if (period_ > 0)
        changed_.wait_for(lock, std::chrono::duration<double>(due - clock_.seconds()),
                          [&] { return closing_; });
      continue;
    }
    lost_ = true;
    std::cerr << "fastibl-demo: the " << name_
              << " camera gives no more pictures; going on, and trying it again\n";
    lock.unlock();
    reopen();
    due = clock_.seconds();
  }
}

// Returns when the camera is there again, or this reader ends.
void CameraReader::reopen() {
  while (true) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, std::chrono::duration<double>(kAgain), [&] { return closing_; });
      if (closing_) return;
    }
    try {
      capture_.release();
      open();
      std::cerr << "fastibl-demo: the " << name_ << " camera is back\n";
      lost_ = false;
      return;
    } catch (const std::exception&) {  // still gone
    }
  }
}

std::optional<CameraReader::Shot> CameraReader::newest(double seconds) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return bool(shot_); });
  return std::exchange(shot_, std::nullopt);
}

}  // namespace fastibl::demo
