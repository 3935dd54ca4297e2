#include "demo/camera_source.h"

#include "demo/pixels.h"
#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

constexpr double kWait = 0.1;  // seconds to wait for a picture before the window has its turn

}  // namespace

CameraSource::CameraSource(const std::string& back, const std::string& front, Rig rig)
    : rig_(std::move(rig)) {
  check(front.empty() || rig_.front, "a front camera was asked for, but the rig has none");
  back_ = std::make_unique<CameraReader>(back, rig_.back, "back", clock_);
  if (!front.empty()) front_ = std::make_unique<CameraReader>(front, *rig_.front, "front", clock_);
}

// The newest pictures of both cameras, stamped with the back camera's time; the front camera's
// alone while the back camera is lost.
std::optional<OwnedFrame> CameraSource::next() {
  const std::optional<CameraReader::Shot> back = back_->newest(kWait);
  if (!back && !(front_ && back_->lost())) return std::nullopt;
  OwnedFrame frame;
  if (back) {
    frame.time = back->time;
    frame.back = rgb_from(back->picture);
    frame.back_exposure = back_->exposure();
  }
  if (!front_) return frame;
  const std::optional<CameraReader::Shot> front = front_->newest(0);
  if (front) {
    frame.front = rgb_from(front->picture);
    frame.front_exposure = front_->exposure();
    if (!back) frame.time = front->time;
  }
  if (!back && !front) return std::nullopt;
  return frame;
}

std::string CameraSource::trouble() const {
  for (const CameraReader* camera : {back_.get(), front_.get()})
    if (camera && camera->lost()) return "the " + camera->name() + " camera is lost";
  return {};
}

}  // namespace fastibl::demo
