// The whole, frame by frame: track, capture, light, shadow, shade, composite. The only long-lived
// object.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fastibl/capture/capture.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/plan/plan.h"
#include "fastibl/render/frame.h"
#include "fastibl/render/light_shares.h"
#include "fastibl/render/light_turns.h"
#include "fastibl/render/measure_errors.h"
#include "fastibl/render/recent_motion.h"
#include "fastibl/render/renderer.h"
#include "fastibl/render/time_budget.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/scene.h"
#include "fastibl/tracking/board_motion.h"
#include "fastibl/tracking/detector.h"
#include "fastibl/tracking/edge_tracker.h"
#include "fastibl/tracking/rotation_tracker.h"
#include "fastibl/tracking/tracker.h"

namespace fastibl {

struct SessionOptions {
  Methods methods;
  // Budgets, 0 for none. Steps whose method is `automatic` get what keeps to them under the light
  // that there is, and other methods when it has changed. By `error` alone all choices are by the
  // light and the scene, the same on every machine.
  double error = 0.02, milliseconds = 0;
  int map_size = 128;
  bool cast_shadow = true;
  double distance = std::numeric_limits<double>::infinity();  // CaptureOptions::distance
  std::optional<RoomBox> box = {};                            // CaptureOptions::box
  bool doubt_exposures = true;                                // CaptureOptions::doubt_exposures
  // By channel: what the front camera makes of light by what the back one makes of it.
  glm::dvec3 front_ratio{1};
  // Whether the surroundings tell how the cameras turn while the board is out of view, and that the
  // board was moved by hand.
  bool follow_surroundings = true;
  std::shared_ptr<const CubeMap> prior = {};  // CaptureOptions::prior, and
  double paper_albedo = 0.85;                 // its paper_albedo
  double most_boost = 1;                      // its most_boost
  // Whether frames that take longer than `milliseconds`, or much less, change the methods, too.
  bool adapt = true;
  Costs costs = {};  // of this machine, see measure_costs.h; of interest for `milliseconds` alone
  bool offline = false;  // see CandidateOptions
};

// What of a map is looked at to tell whether it is another light.
struct LightSummary {
  std::array<glm::vec3, 6> faces;  // mean radiances
  float compact = 0;               // share of all light that is far above the mean
};

class Session {
 public:
  // rig: needed for anything but a fixed environment with given poses, and always for the size of
  // the picture. board and detector: where poses are tracked. environment: null where it is
  // captured. Throws std::invalid_argument for a camera or board that is none, or tracking without
  // a detector.
  Session(Scene scene, Rig rig, std::optional<Board> board,
          std::shared_ptr<const Environment> environment, Detector detector,
          std::unique_ptr<Renderer> renderer, SessionOptions options = {});

  FrameResult process(const Frame& frame);

  const Plan& plan() const { return plan_; }
  const SessionOptions& options() const { return options_; }
  ShadowMap shadow_map() { return renderer_->shadow_map(); }
  // What the plane's picture was multiplied by: the ratio as it is drawn, and the light of the
  // object; it may exceed 1.
  ShadowMap plane_gain() {
    return shares_.plane_gain() ? *shares_.plane_gain() : renderer_->shadow_map();
  }
  ObjectLayer object() { return renderer_->object(); }
  ObjectLayer holdout() { return renderer_->holdout(); }  // see holdout_layer()
  const Capture& capture() const { return *capture_; }
  Renderer& renderer() { return *renderer_; }

  const Scene& scene() const { return scene_; }
  // Another object, at the map that was captured: its centre stays where the first object's was.
  void set_scene(Scene scene);
  void set_material(const Material& material);
  void move(const Pose& marker_from_object);
  void set_methods(const Methods& methods);
  // SessionOptions::error and milliseconds; throws std::invalid_argument for values that are
  // negative or not finite.
  void set_budgets(double error, double milliseconds);
  void set_cast_shadow(bool cast);
  // Of the scene's mesh, or null.
  void set_baked_shadow(std::shared_ptr<const MeshShadow> baked);
  void set_shadow_look(const ShadowLook& look);
  // null: capture. Light that is given in every frame is taken for light that moves; see
  // session.cpp.
  void set_environment(std::shared_ptr<const Environment> environment);
  void set_renderer(std::unique_ptr<Renderer> renderer);

 private:
  bool light_moves() const;               // it is captured, or given frame after frame
  void update_plan(bool choose = false);  // the lines and their errors; and methods anew
  void choose_methods();                  // where the light has changed, or the time is up
  void make_stale();                      // all that methods make
  void watch_time(double milliseconds);
  void replan();      // after a change of what is wanted: makes stale what it concerns
  void judge_anew();  // the same after a change of the light
  LightingOptions lighting_options() const;
  // drawn_from: the pose that the object is drawn with, see drawn_pose.
  bool run_pass(PassId id, const Frame& frame, FrameResult& result, const Pose& drawn_from);
  std::optional<Pose> find_pose(const Frame& frame, FrameResult& result);
  void follow_surroundings(const Frame& frame, FrameResult& result);
  void choose_turn(const Frame& frame);
  bool wants_capture(const Frame& frame, const std::optional<Pose>& pose) const;
  bool is_single_exposure(const Frame& frame) const;
  void capture_frame(const Frame& frame, FrameResult& result);
  void find_motion(const Frame& frame, FrameResult& result);
  // Of the row that shows the middle of the object.
  Pose drawn_pose(const FrameResult& result) const;

  Scene scene_;
  Rig rig_;
  std::optional<Board> board_;
  std::shared_ptr<const Environment> environment_;
  bool fixed_environment_;
  Detector detector_;
  std::optional<EdgeTracker> edge_tracker_;
  std::optional<RotationTracker> rotation_tracker_;
  std::uint64_t moments_ = 0;                   // that it was asked about
  std::optional<glm::dmat3> known_attitude_;    // where the tracker last went on from
  std::optional<glm::dmat3> tracked_attitude_;  // of the last pose of the board
  BoardMotion board_motion_;
  double look_again_ = -1e30, agreed_ = -1e30;  // seconds
  struct Known {
    Pose pose;
    double time;
    std::optional<glm::dmat3> attitude;
  };
  std::optional<Known> between_looks_;  // the last pose since
  std::optional<Pose> turned_;          // of this frame, sure enough to capture with
  bool hold_capture_ = false;           // the board seems to move
  bool given_elsewhere_ = false;        // the given light does not lie as the surroundings do
  std::unique_ptr<Renderer> renderer_;
  SessionOptions options_;
  std::optional<Capture> capture_;
  std::shared_ptr<const Lighting> lighting_;
  LightShares shares_;
  Plan plan_;
  MeasuredErrors measured_;
  std::optional<ErrorMeasurement> measurement_;  // that goes on
  std::optional<LightSummary> measured_light_;
  bool measure_due_ = true, choose_due_ = false;
  // Frames: methods judged, light given, light given that is new.
  int since_measured_ = 0, since_set_ = 0, since_new_ = 0;
  int set_in_a_row_ = 0;  // times that light was given frame after frame
  TimeBudget time_;
  LightTurns turns_;
  bool in_turns_ = false;  // this frame
  float light_lag_ = 0;    // by which the light changed from one of its turns to the next, relative
  Products stale_ = product::all & ~product::inputs;
  Products held_ = 0;  // what pictures made stale, until the light's turn
  RecentMotion recent_;
  std::optional<MotionRate> motion_;  // of the back camera at last_pose_
  std::optional<Pose> last_pose_;
  double last_pose_time_ = 0;
  std::optional<double> last_time_;
  double back_exposure_ = 1;  // of the last back picture, as far as it is known
  // What the map last said of the exposures of a camera that tells none, for its next picture.
  struct ReadExposure {
    std::optional<double> last;
    bool steady = false;  // as that before it: no bracket
    void read(const Taken& taken);
    std::optional<double> next() const { return steady ? last : std::nullopt; }
  };
  ReadExposure read_back_, read_front_;
  int mended_ = 0;                                             // as the capture had it
  std::optional<double> last_capture_time_, single_exposure_;  // of the paper's single pictures
};

}  // namespace fastibl
