#include "fastibl/tracking/edge_tracker.h"

#include <cmath>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/solve.h"
#include "fastibl/tracking/roll_corners.h"

namespace fastibl {
namespace {

constexpr double kFrame = 1.0 / 30;  // seconds, where no times are given
constexpr double kSlowest = 0.02;    // radians a frame to which a prediction is trusted, at best
constexpr double kUnknown = 0.2;     // the same without a velocity

// From a to b, by a share of the way; beyond b for shares over 1.
Pose between(const Pose& a, const Pose& b, double share) {
  const glm::dvec3 turn = rotation_vector(b.rotation * glm::transpose(a.rotation));
  return {rotation_from_vector(share * turn) * a.rotation,
          a.translation + share * (b.translation - a.translation)};
}

// What corners alone give to predict from: their pose, and a motion that may be any hand's.
std::optional<RowState> state_of_corners(const Tracked& tracked, double readout) {
  RowState state{tracked.camera_from_marker, {}, {}};
  if (tracked.last_row) state.motion = motion_between(state.pose, *tracked.last_row);
  RowPrior known = unknown_hand(state.pose, readout);
  std::array<double, 36> pose{};
  if (!invert<6>(tracked.covariance, pose)) return std::nullopt;
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k) known.information[kRowParameters * i + k] = pose[6 * i + k];
  if (!invert<kRowParameters>(known.information, state.covariance)) return std::nullopt;
  return state;
}

}  // namespace

EdgeTracker::EdgeTracker(const Board& board, const Camera& camera, EdgeTrackingOptions options)
    : board_(board), camera_(camera), options_(options), model_(board, camera) {
  camera_.validate();
  board_.validate();
  check(options_.most_edges > 0 && options_.most_rounds > 0,
        "most_edges and most_rounds must be positive, got ", options_.most_edges, " ",
        options_.most_rounds);
  check(options_.smoothing >= 0 && std::isfinite(options_.smoothing),
        "smoothing must be a time from 0 seconds on, got ", options_.smoothing);
}

namespace {

// Gives a pose another rotation about the camera's place.
void turn_about_camera(Pose& pose, const glm::dmat3& rotation) {
  pose.translation = rotation * (glm::transpose(pose.rotation) * pose.translation);
  pose.rotation = rotation;
}

}  // namespace

// Predicts by constant velocity; a gyroscope's turn takes the place of the last one.
Pose EdgeTracker::predicted(double time, const MotionHint& hint) const {
  Pose pose = last_->pose;
  const double step = time - last_->time;
  if (before_ && last_->time > before_->time)
    pose = between(before_->pose, last_->pose, 1 + step / (last_->time - before_->time));
  if (hint.turn) turn_about_camera(pose, *hint.turn * last_->pose.rotation);
  return pose;
}

Pose EdgeTracker::predicted_rows(double time, const MotionHint& hint, PosePrior& prior) const {
  const double readout = camera_.readout;
  const double step = time - last_->time;
  const RowState state = after(rows_, step / readout, hand_jerk(readout));
  prior.rows = prior_of(state, hand_jerk(readout));
  if (!hint.turn) return state.pose;
  Pose start = state.pose;
  turn_about_camera(start, *hint.turn * last_->pose.rotation);
  return start;
}

std::optional<Tracked> EdgeTracker::detect(const Picture& picture,
                                           ImageView<const std::uint8_t> bytes,
                                           const PosePrior& prior, const Detector& detector) {
  const Image<std::uint8_t> grey = grey_from(picture, camera_.response);
  TrackingOptions options;
  options.method = TrackingMethod::board;
  const auto start = fastibl::track(detector, grey.view(), board_, camera_, options);
  if (!start) return std::nullopt;
  // Where corners tell of a motion, they tell it roughly: the pose between the first and the last
  // row serves as that of all.
  const Pose near = start->last_row ? between(start->camera_from_marker, *start->last_row, 0.5)
                                    : start->camera_from_marker;
  PosePrior by_corners = prior;
  by_corners.by_corners = true;
  auto tracked = model_.track(bytes, near, by_corners, options_, &rows_);
  // Where edges cannot be followed, the corners' word counts, if it is one.
  if (!tracked && (start->ambiguous || start->tags.size() < 2)) return std::nullopt;
  if (tracked || !(camera_.readout > 0)) return tracked ? tracked : start;
  const auto state = state_of_corners(*start, camera_.readout);
  if (!state) return std::nullopt;
  rows_ = *state;
  return start;
}

void EdgeTracker::smooth(Tracked& tracked, double time) {
  const Pose pose = tracked.camera_from_marker;
  if (options_.smoothing > 0 && shown_ && time > shown_->time) {
    const double step = time - shown_->time;
    // The pose lags behind a steady motion by the time constant, whatever the rate.
    tracked.camera_from_marker = between(shown_->pose, pose, step / (options_.smoothing + step));
    add_difference(pose, 1, tracked);  // it stays behind the measured one
    if (tracked.last_row)
      tracked.last_row = *tracked.last_row * pose.inverse() * tracked.camera_from_marker;
  }
  shown_ = Moment{tracked.camera_from_marker, time};
}

std::optional<Tracked> EdgeTracker::track(const Picture& picture, std::optional<double> given,
                                          const Detector& detector, const MotionHint& hint) {
  check(picture.width == camera_.width && picture.height == camera_.height, "the picture is ",
        picture.width, " x ", picture.height, ", but the camera is ", camera_.width, " x ",
        camera_.height);
  check_picture(picture);
  check(detector != nullptr, "an edge tracker needs a detector");
  const double time = given.value_or(clock_ + kFrame);
  check(std::isfinite(time) && (!last_ || time >= last_->time),
        "time must not run backwards: ", time, " s after ", last_ ? last_->time : 0, " s");
  clock_ = time;
  if (last_ && time - last_->time > options_.longest_gap) forget();

  Image<std::uint8_t> converted;
  if (picture.type != PixelType::uint8)
    converted = bytes_from(picture, camera_.response, scale_below_white(picture));
  const ImageView<const std::uint8_t> bytes =
      converted.empty() ? ImageView<const std::uint8_t>{picture.row(0), picture.width,
                                                        picture.height, 3, picture.stride()}
                        : std::as_const(converted).view();
  PosePrior prior;
  prior.gravity_in_marker = options_.gravity_in_marker;
  if (hint.gravity && glm::length(*hint.gravity) > 0) prior.gravity = glm::normalize(*hint.gravity);
  std::optional<Tracked> tracked;
  if (last_) {
    const bool rolling = camera_.readout > 0;
    const Pose start = rolling ? predicted_rows(time, hint, prior) : predicted(time, hint);
    prior.rotation = start.rotation;
    prior.deviation = before_ || hint.turn ? kSlowest : kUnknown;
    tracked = model_.track(bytes, start, prior, options_, &rows_);
    prior.rows.reset();  // it led nowhere, or is no longer needed
  }
  if (tracked) {
    if (time > last_->time) before_ = last_;  // the same picture again tells of no motion
  } else {
    tracked = detect(picture, bytes, prior, detector);
    shown_.reset();  // it may be elsewhere
    // What was predicted from may still hold in the next frame; it is proved there.
    if (!tracked) return std::nullopt;
    before_.reset();
  }
  last_ = Moment{tracked->camera_from_marker, time};
  smooth(*tracked, time);
  return tracked;
}

}  // namespace fastibl
