#include "fastibl/render/rig_capture.h"

#include <cmath>
#include <utility>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

constexpr double kSteadyExposure = 0.3;  // ln, between one picture and the next
constexpr int kFront = 1;                // the camera's number; the back one's is 0
constexpr double kSinglePeriod = 5;  // seconds between the paper's front pictures, of one exposure
constexpr double kSameExposure = 0.05;  // largest difference of ln exposure that counts as the same
constexpr double kSinglePatience = 8;   // seconds after which another exposure will do

const glm::dvec3& checked(const glm::dvec3& ratio) {
  check(ratio.x > 0 && ratio.y > 0 && ratio.z > 0 && std::isfinite(ratio.x + ratio.y + ratio.z),
        "a front_ratio must be positive and finite, got ", ratio.x, " ", ratio.y, " ", ratio.z);
  return ratio;
}

}  // namespace

RigCapture::RigCapture(Rig rig, CaptureOptions options, const glm::dvec3& front_ratio)
    : rig_(std::move(rig)), front_ratio_(checked(front_ratio)), map_(std::move(options)) {}

void RigCapture::ReadExposure::read(const Taken& taken) {
  std::optional<double> now;
  if (taken.as != TakenAs::left_out) now = taken.exposure;
  steady = now && last && std::abs(std::log(*now / *last)) <= kSteadyExposure;
  last = now;
}

RigPictures RigCapture::pictures(const Frame& frame) const {
  RigPictures pictures;
  if (const auto exposure = frame.back_exposure ? frame.back_exposure : read_back_.next())
    pictures.back = frame.back, pictures.back_exposure = *exposure;
  if (const auto exposure = frame.front_exposure ? frame.front_exposure : read_front_.next()) {
    pictures.front = frame.front;
    pictures.front_exposure = *exposure * front_ratio_.y;  // compared is green
  }
  return pictures;
}

// Whether a front picture has the exposure of the first that was captured.
bool RigCapture::is_single_exposure(const Frame& frame) const {
  if (!frame.front_exposure || !single_exposure_) return !frame.front_exposure && !single_exposure_;
  return std::abs(std::log(*frame.front_exposure / *single_exposure_)) <= kSameExposure;
}

bool RigCapture::wants(const Frame& frame, const FrameResult& found, const Turn& turn,
                       CaptureMethod method, const RigTracker& tracker) const {
  if (tracker.board_moves()) return false;
  const bool placed = found.back_from_marker || tracker.turned();
  const bool front =
      turn.front && (placed || (frame.back.empty() && tracker.is_recent(frame.time)));
  if (method == CaptureMethod::continuous) return front || (placed && turn.back);
  if (!front || !last_time_) return front;
  const double since = frame.time - *last_time_;
  return since >= kSinglePeriod && (since >= kSinglePatience || is_single_exposure(frame));
}

bool RigCapture::add(const Frame& frame, const Turn& turn, const RigTracker& tracker,
                     FrameResult& result) {
  if (turn.back && (result.back_from_marker || tracker.turned())) add_back(frame, tracker, result);
  if (turn.front) add_front(frame, tracker, result);
  return map_.mended() != std::exchange(mended_, map_.mended());
}

void RigCapture::add_back(const Frame& frame, const RigTracker& tracker, FrameResult& result) {
  const bool by_board = result.back_from_marker.has_value();
  std::optional<Pose> last_row = result.back_last_row;
  if (!by_board && rig_.back.readout > 0) last_row = tracker.turned_at(rig_.back.readout);
  result.back_taken =
      map_.add(frame.back, rig_.back, by_board ? *result.back_from_marker : tracker.turned_at(0),
               frame.back_exposure, frame.time, {}, last_row, glm::dvec3(1), by_board);
  read_back_.read(*result.back_taken);
}

void RigCapture::add_front(const Frame& frame, const RigTracker& tracker, FrameResult& result) {
  const bool turned = tracker.turned();
  const auto front_after = [&](double later) {
    return rig_.front_from_back *
           (turned ? tracker.turned_at(later) : tracker.back_at(frame.time + later));
  };
  std::optional<Pose> last_row;
  if (rig_.front->readout > 0) last_row = front_after(rig_.front->readout);
  result.front_taken = map_.add(frame.front, *rig_.front, front_after(0), frame.front_exposure,
                                frame.time, {}, last_row, front_ratio_, !turned, kFront);
  read_front_.read(*result.front_taken);
  if (result.front_taken->as == TakenAs::left_out) return;
  if (!last_time_ || !is_single_exposure(frame)) single_exposure_ = frame.front_exposure;
  last_time_ = frame.time;
}

}  // namespace fastibl
