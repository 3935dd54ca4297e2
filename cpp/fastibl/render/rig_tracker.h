// Finds where a session's cameras are: by the board or, where that is out of view, by the
// surroundings.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/render/frame.h"
#include "fastibl/render/recent_motion.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/methods.h"
#include "fastibl/tracking/board_motion.h"
#include "fastibl/tracking/detector.h"
#include "fastibl/tracking/edge_tracker.h"
#include "fastibl/tracking/gyro_model.h"
#include "fastibl/tracking/rotation_tracker.h"

namespace fastibl {

// What is known of the surroundings when a frame comes.
struct SeenAround {
  std::function<std::shared_ptr<const Environment>()> map;  // called where it is needed
  bool mapped = false;                                      // whether there is one yet
  MapSurface surface;                                       // of what it shows
  RigPictures pictures;  // those of the frame with known exposure
  bool look = true;      // whether to compare the board with them in this frame
  bool rarely = false;   // such looks take time from other work
};

class RigTracker {
 public:
  // board: nothing where poses are given. The rotation is followed by the surroundings if that is
  // asked for, there is a board, and the back camera is a perspective one. The surroundings are
  // followed in its pictures, and also in the front camera's if that is a perspective one.
  RigTracker(Rig rig, std::optional<Board> board, Detector detector, bool follow_surroundings);

  bool has_board() const { return board_.has_value(); }

  // Finds the pose as the frame gives it or, where the board is in view, as it is tracked; sets
  // `back_from_marker` and `tracked` of the result. False where there was nothing to track.
  bool find_pose(const Frame& frame, TrackingMethod method, FrameResult& result);
  // Call after find_pose(). Where the board is in view: whether it still lies where it lay;
  // newmarker_from_oldmarker if it was moved. Where it is out of view: how the cameras turned,
  // `turned` of the result.
  std::optional<glm::dmat3> follow(const Frame& frame, SeenAround around, FrameResult& result);
  // Takes the pose, if any, and finds the motion of the rows: as tracked or given, or else that of
  // the last frames.
  void find_motion(const Frame& frame, FrameResult& result);
  // Call when what was seen of the surroundings is no longer true.
  void forget_surroundings();

  bool look_due(double time) const { return rotation_tracker_ && time >= look_again_; }
  bool board_moves() const { return board_moves_; }  // as the last frame shows
  // Whether the surroundings tell the last frame's rotation surely enough to capture with it.
  bool turned() const { return turned_.has_value(); }
  // The pose by that rotation, some seconds later.
  Pose turned_at(double later) const;
  // Whether the last pose, by the board or given, may still stand for the pose at a given time.
  bool is_recent(double time) const;
  // The pose then, by the last pose and its motion.
  Pose back_at(double time) const;
  // The pose of the row that shows a point of the marker frame.
  Pose pose_of_row(const FrameResult& result, const glm::dvec3& point) const;

 private:
  struct Known {
    Pose pose;
    double time, variance;
    std::optional<glm::dvec3> velocity;
    std::optional<Attitude> attitude;
  };
  Known known(const Tracked& pose, const Frame& frame) const;
  void start(const Known& known, const RigPictures& pictures);
  void keep_until_look(const Known& known);

  Rig rig_;
  std::optional<Board> board_;
  Detector detector_;
  std::optional<EdgeTracker> edge_tracker_;
  std::optional<RotationTracker> rotation_tracker_;
  std::uint64_t moments_ = 0;  // counts the moments that it was asked about
  GyroModel gyro_;
  std::optional<Attitude> attitude_;          // in this frame
  std::optional<Attitude> known_attitude_;    // where the rotation tracker last went on from
  std::optional<Attitude> tracked_attitude_;  // at the last pose by the board
  BoardMotion board_motion_;
  double look_again_ = -1e30, agreed_ = -1e30;  // seconds
  std::vector<Known> between_looks_;            // poses since the last look
  bool follows_front_ = false;
  std::optional<Turned> turned_;
  bool board_moves_ = false;
  RecentMotion recent_;
  std::optional<MotionRate> motion_;  // at last_pose_
  std::optional<Pose> last_pose_;
  double last_pose_time_ = 0;
};

}  // namespace fastibl
