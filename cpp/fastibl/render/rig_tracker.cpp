#include "fastibl/render/rig_tracker.h"

#include <algorithm>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/tracking/tracker.h"

namespace fastibl {
namespace {

// Seconds for which a front picture may use an earlier pose, plus the rounding of times.
constexpr double kPoseLifetime = 0.1 + 1e-6;
// Nothing is captured with a rotation by the surroundings that is less sure than this, drift of the
// map aside: later pictures are followed by what was captured. A fifth of a texel of 128.
constexpr double kMostTurnDeviation = 0.3 * kDegree;
// Up to this deviation, a rotation by a gyroscope tells the least turn of a board from its own
// error.
constexpr double kSureTurn = 0.3 * kDegree;
// Seconds between looks around while the board is in view and does not move: where the surroundings
// agree with it, and where they do not because they are near, which takes longer to find out.
constexpr double kLookAround = 0.06, kLookAroundNear = 0.25;
constexpr double kLookAroundRarely = 1;  // seconds: each costs as much as a picture's capture
constexpr double kDoubt = 0.6;  // seconds of disagreeing after which surroundings count as near

// Mean over the axes, rad².
double rotation_variance(const Tracked& pose) {
  return (pose.covariance[0] + pose.covariance[7] + pose.covariance[14]) / 3;
}

bool is_perspective(const Camera& camera) { return camera.model == CameraModel::perspective; }

}  // namespace

RigTracker::RigTracker(Rig rig, std::optional<Board> board, Detector detector,
                       bool follow_surroundings)
    : rig_(std::move(rig)), board_(std::move(board)), detector_(std::move(detector)) {
  if (!board_) return;
  board_->validate();
  check(detector_ != nullptr, "a session with a board needs a detector");
  edge_tracker_.emplace(*board_, rig_.back);
  if (!follow_surroundings) return;
  Rig followed = rig_;
  follows_front_ = rig_.front && is_perspective(*rig_.front);
  if (!follows_front_) followed.front.reset();
  rotation_tracker_.emplace(std::move(followed));
}

bool RigTracker::find_pose(const Frame& frame, TrackingMethod method, FrameResult& result) {
  turned_.reset(), board_moves_ = false;
  const bool believed = gyro_.trusted();
  attitude_ = frame.attitude ? gyro_.add(frame.time, *frame.attitude) : std::nullopt;
  if (believed && !gyro_.trusted()) {  // what it told of the board is not trusted either
    board_motion_ = BoardMotion();
    forget_surroundings();
  }
  result.back_from_marker = frame.back_from_marker;
  if (frame.back_from_marker || !board_) return false;
  if (frame.back.empty()) return true;
  if (method == TrackingMethod::automatic || method == TrackingMethod::edges) {
    MotionHint hint;
    if (attitude_ && tracked_attitude_)
      hint.turn = attitude_->rotation * glm::transpose(tracked_attitude_->rotation);
    result.tracked = edge_tracker_->track(frame.back, frame.time, detector_, hint);
    if (result.tracked) tracked_attitude_ = attitude_;
  } else {
    edge_tracker_->reset();
    TrackingOptions options;
    options.method = method;
    const Image<std::uint8_t> grey = grey_from(frame.back, rig_.back.response);
    result.tracked = track(detector_, grey.view(), *board_, rig_.back, options);
  }
  if (!result.tracked) return true;
  result.back_from_marker = result.tracked->camera_from_marker;
  if (frame.attitude)
    gyro_.add_board(result.back_from_marker->rotation, rotation_variance(*result.tracked));
  return true;
}

// What a pose by the board tells of the rotation, and of its velocity where the rows show it.
RigTracker::Known RigTracker::known(const Tracked& pose, const Frame& frame) const {
  Known known{pose.camera_from_marker, frame.time, rotation_variance(pose), {}, attitude_};
  if (pose.last_row && rig_.back.readout > 0)
    known.velocity = rotation_vector(glm::transpose(pose.camera_from_marker.rotation) *
                                     pose.last_row->rotation) /
                     rig_.back.readout;
  return known;
}

void RigTracker::start(const Known& known, const RigPictures& pictures) {
  RigPictures with = pictures;
  with.velocity = known.velocity;
  rotation_tracker_->start(known.pose, known.time, with, known.variance);
  known_attitude_ = known.attitude;
}

// Poses of one time tell no motion: the last one stands for them.
void RigTracker::keep_until_look(const Known& known) {
  if (!between_looks_.empty() && between_looks_.back().time == known.time)
    between_looks_.pop_back();
  between_looks_.push_back(known);
}

void RigTracker::forget_surroundings() {
  if (rotation_tracker_) rotation_tracker_->forget();
}

std::optional<glm::dmat3> RigTracker::follow(const Frame& frame, SeenAround around,
                                             FrameResult& result) {
  if (!rotation_tracker_) return std::nullopt;
  rotation_tracker_->set_surface(around.surface);
  RigPictures& pictures = around.pictures;
  pictures.number = ++moments_;
  if (!follows_front_) pictures.front = {};
  const auto track = [&] {
    std::optional<glm::dmat3> turn;
    if (attitude_ && known_attitude_)
      turn = attitude_->rotation * glm::transpose(known_attitude_->rotation);
    known_attitude_ = attitude_;
    return rotation_tracker_->track(*around.map(), pictures, frame.time, turn,
                                    attitude_ ? attitude_->variance : 0);
  };
  if (!around.mapped) {
    // Before there is a map, there may be a pose to start from.
    if (result.tracked) start(known(*result.tracked, frame), pictures);
    return std::nullopt;
  }
  if (!result.tracked) {
    // A front picture alone uses the last pose for a while.
    if (frame.back.empty() && is_recent(frame.time)) return std::nullopt;
    for (const Known& pose : between_looks_) start(pose, {});
    between_looks_.clear();
    result.turned = track();
    if (result.turned && result.turned->own_deviation() < kMostTurnDeviation)
      turned_ = result.turned;
    return std::nullopt;
  }
  const Known by_board = known(*result.tracked, frame);
  const Pose& pose = by_board.pose;
  if (!board_motion_.moving() && !around.look) {
    keep_until_look(by_board);
    return std::nullopt;
  }
  between_looks_.clear();  // they come from the board, and whether it lies still is the question
  pictures.velocity = by_board.velocity;
  const Agreement agreement = rotation_tracker_->compare(pose, pictures);
  std::optional<Turned> turned;
  // Turned far, a board leaves nothing of the map to compare with; the surroundings may still be
  // followed from picture to picture.
  const bool asks = attitude_ || board_motion_.moving();
  if (agreement == Agreement::differs || (agreement == Agreement::nothing && asks))
    turned = track();
  board_motion_.look(pose, agreement, turned, frame.time);
  if (agreement != Agreement::differs) agreed_ = frame.time;
  look_again_ = frame.time - 1e-6 +
                (around.rarely                   ? kLookAroundRarely
                 : frame.time - agreed_ < kDoubt ? kLookAround
                                                 : kLookAroundNear);
  board_moves_ = board_motion_.moving();
  const std::optional<glm::dmat3> moved = board_motion_.moved();
  if (moved) rotation_tracker_->forget();
  // By a gyroscope a slow turn of a board is seen, too, if no look starts anew from the board.
  const bool told = attitude_ && turned && turned->own_deviation() < kSureTurn;
  if (board_moves_) return moved;
  if (told && !moved)
    keep_until_look(by_board);
  else
    start(by_board, pictures);
  return moved;
}

void RigTracker::find_motion(const Frame& frame, FrameResult& result) {
  if (!result.back_from_marker) return;
  const Pose& pose = *result.back_from_marker;
  const double readout = rig_.back.readout;
  recent_.add(frame.time, pose);
  result.back_last_row = result.tracked ? result.tracked->last_row : frame.back_last_row;
  if (result.back_last_row)
    motion_ = MotionRate{motion_between(pose, *result.back_last_row), readout};
  else if (motion_ = recent_.motion(); motion_ && readout > 0)
    result.back_last_row = motion_->later(pose, readout);
  last_pose_ = pose, last_pose_time_ = frame.time;
}

bool RigTracker::is_recent(double time) const {
  return last_pose_ && time - last_pose_time_ <= kPoseLifetime;
}

Pose RigTracker::back_at(double time) const {
  const double later = time - last_pose_time_;
  return motion_ && later > 0 ? motion_->later(*last_pose_, later) : *last_pose_;
}

Pose RigTracker::turned_at(double later) const {
  const Pose pose = turned_->back_from_marker;
  const glm::dmat3 turn = rotation_from_vector(later * turned_->velocity);
  const glm::dmat3 rotation = orthonormal(pose.rotation * turn);
  return {rotation, rotation * (glm::transpose(pose.rotation) * pose.translation)};
}

Pose RigTracker::pose_of_row(const FrameResult& result, const glm::dvec3& point) const {
  const Pose& first = *result.back_from_marker;
  if (!result.back_last_row) return first;
  const RowMotion motion = motion_between(first, *result.back_last_row);
  const Pose middle = motion.moved(first, 0.5);
  const auto pixel = rig_.back.project(middle * point);
  const double share = pixel ? std::clamp(pixel->y / rig_.back.height, 0.0, 1.0) : 0.5;
  return motion.moved(first, share);
}

}  // namespace fastibl
