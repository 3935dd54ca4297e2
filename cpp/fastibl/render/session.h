// The whole pipeline, frame by frame: track, capture, light, shadow, shade, composite. It is the
// only long-lived object.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "fastibl/capture/light_meter.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/plan/plan.h"
#include "fastibl/render/frame.h"
#include "fastibl/render/frame_clock.h"
#include "fastibl/render/light_shares.h"
#include "fastibl/render/light_stream.h"
#include "fastibl/render/light_turns.h"
#include "fastibl/render/method_judge.h"
#include "fastibl/render/renderer.h"
#include "fastibl/render/rig_capture.h"
#include "fastibl/render/rig_tracker.h"
#include "fastibl/render/time_budget.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/composite.h"
#include "fastibl/shading/in_view.h"
#include "fastibl/tracking/detector.h"

namespace fastibl {

struct SessionOptions {
  Methods methods;
  // Budgets, 0 for none. A step whose method is `automatic` gets one that keeps to them under the
  // present light, and another one when the light has changed. With `error` alone, all choices
  // depend on the light and the scene only, so that they are the same on every machine.
  double error = 0.02, milliseconds = 0;
  int map_size = 128;
  bool cast_shadow = true;
  std::optional<double> distance = {};  // CaptureOptions::distance
  std::optional<RoomBox> box = {};      // CaptureOptions::box
  bool doubt_exposures = true;          // CaptureOptions::doubt_exposures
  // By channel: the front camera's measure of light divided by the back camera's.
  glm::dvec3 front_ratio{1};
  // Whether the surroundings are used to tell how the cameras turn while the board is out of view,
  // and that the board was moved by hand.
  bool follow_surroundings = true;
  std::shared_ptr<const CubeMap> prior = {};  // CaptureOptions::prior, and
  double paper_albedo = 0.85;                 // its paper_albedo
  std::optional<double> most_boost = {};      // its most_boost
  // Whether the methods also change when frames take longer than `milliseconds`, or much less.
  bool adapt = true;
  Costs costs = {};      // of this machine, see measure_costs.h; used for `milliseconds` alone
  bool offline = false;  // see CandidateOptions
  // The object is drawn so many times as large along each axis, and averaged: 4 samples a pixel
  // become 4 supersampling².
  int supersampling = 1;
  // Whether FrameResult::image gets the picture. Without, it stays with the renderer, for
  // Renderer::image or GlRenderer::present, and a GPU need not give it back.
  bool read_back = true;
};

class Session {
 public:
  // rig: needed for anything but a fixed environment with given poses, and always for the size of
  // the picture. board and detector: needed where poses are tracked. environment: null where it is
  // captured. Throws std::invalid_argument for an invalid camera or board, or for tracking without
  // a detector.
  Session(Scene scene, Rig rig, std::optional<Board> board,
          std::shared_ptr<const Environment> environment, Detector detector,
          std::unique_ptr<Renderer> renderer, SessionOptions options = {});

  FrameResult process(const Frame& frame);
  // The same into the result of an earlier frame, whose memory is used again. Its image must not be
  // the frame's picture. Nothing is known of the result where this throws.
  void process(const Frame& frame, FrameResult& result);
  // The next frame may have any time: a camera's clock was set, or a frame had a wrong one. What
  // was captured counts as a second older.
  void restart_clock() { clock_.restart(); }

  const Plan& plan() const { return plan_; }
  const SessionOptions& options() const { return options_; }
  // Whether the back end has it: naming another one is refused.
  bool has(SelfShadowMethod method) const { return renderer_->has(method); }
  // These maps are there until the next frame: copy what is to be kept. A frame that casts no
  // shadow leaves the last ones; they are empty before the first and while the shadow is off.
  const ShadowMap& shadow_map() { return renderer_->shadow_map(); }
  // What the plane's picture was multiplied by: the ratio as it is drawn, together with the light
  // from the object; it may exceed 1.
  const ShadowMap& plane_gain() {
    if (kept_gain_) return *kept_gain_;
    return shares_.plane_gain() ? *shares_.plane_gain() : renderer_->shadow_map();
  }
  // The layers of the last picture; empty where the board was not seen, or nothing of the scene
  // is in the picture.
  ObjectLayer object() { return drawn_from_ ? renderer_->object() : ObjectLayer{}; }
  ObjectLayer holdout() { return drawn_from_ ? renderer_->holdout() : ObjectLayer{}; }
  // The layers that the last picture was put together from, also after anything was set but another
  // scene or renderer. Nothing covers or shades it where those are empty.
  PictureLayers layers();
  const Capture& capture() const { return capture_.map(); }
  Renderer& renderer() { return *renderer_; }

  const Scene& scene() const { return scene_; }
  // Sets another object under the captured map, whose centre stays where the first object's was.
  void set_scene(Scene scene);
  void set_material(const Material& material);
  void move(const Pose& marker_from_object);
  void set_methods(const Methods& methods);
  // SessionOptions::error and milliseconds; throws std::invalid_argument for an error outside of
  // 0 to 1, or a time that is negative or not finite.
  void set_budgets(double error, double milliseconds);
  void set_cast_shadow(bool cast);
  // baked: of the scene's mesh, or null.
  void set_baked_shadow(std::shared_ptr<const MeshShadow> baked);
  void set_shadow_look(const ShadowLook& look);
  // null: capture. Light that is given in every frame is taken as moving light; see session.cpp.
  void set_environment(std::shared_ptr<const Environment> environment);
  void set_renderer(std::unique_ptr<Renderer> renderer);

 private:
  bool lit() const;          // whether there is a map that holds light
  bool light_moves() const;  // whether it is captured, or given frame after frame
  void replan();             // after a change of what is asked for: makes stale what depends on it
  void judge_anew();         // the same after a change of the light
  void choose_methods();     // where the light has changed, or the time budget asks for it
  void update_plan(bool choose = false);  // the lines and their errors; if asked, new methods
  void keep_gain();
  void forget_drawn();
  bool shows_back(const Frame& frame) const;
  double exposure_of(const Frame& frame) const;
  void make_stale();  // all that depends on methods
  void watch_time(double milliseconds, bool shaded);
  void choose_turn(const Frame& frame);
  void follow_surroundings(const Frame& frame, FrameResult& result);
  RigCapture::Turn pictures_turn() const;
  bool wants_capture(const Frame& frame, const FrameResult& found) const;
  std::shared_ptr<const CubeMap> radiance() const;  // null before there is a map
  // Of the environment, which must be there.
  NearLights near_lights() const;
  LightSummary light_summary() const;
  const Camera& drawn_camera() const;  // the back one, or that of the renderer's texture
  LightingOptions lighting_options() const;
  void ensure_lighting();  // for this map, with the chain that glossy light is read from
  // Reads the exposure of a back picture without one from the board's white, where the light is
  // given or only the front camera's. It stays as it was where that white is not seen.
  void read_exposure(const Frame& frame, const Pose& drawn_from);
  // drawn_from: the pose that the object is drawn with, that of the row that shows its middle.
  bool run_pass(PassId id, const Frame& frame, FrameResult& result, const Pose& drawn_from);
  void run_passes(const std::vector<PassId>& due, const Frame& frame, FrameResult& result,
                  const Pose& drawn_from);
  bool is_due(PassId id, Products wanted) const;  // whether it would run now
  // The pose of the row that shows the object's middle, of a frame with a pose.
  Pose pose_of_object(const FrameResult& result) const;
  bool may_show(const Pose& drawn_from);  // whether anything of the scene can be in the picture
  void see_first_light(const Frame& frame, FrameResult& result, const Pose& drawn_from);
  void run_due(const Frame& frame, FrameResult& result);

  Scene scene_;
  Rig rig_;
  std::shared_ptr<const Environment> environment_;
  bool fixed_environment_;
  std::unique_ptr<Renderer> renderer_;
  SessionOptions options_;
  RigTracker tracker_;
  RigCapture capture_;
  std::shared_ptr<const Lighting> lighting_;
  LightShares shares_;
  Plan plan_;
  Products stale_ = product::all & ~product::inputs;
  MethodJudge judge_;
  LightStream stream_;            // of the light that is given
  bool given_elsewhere_ = false;  // the given light is not aligned with the surroundings
  TimeBudget time_;
  LightTurns turns_;
  bool in_turns_ = false;  // this frame
  float light_lag_ = 0;    // relative change of the light from one of its turns to the next
  int changes_seen_ = 0;   // of the capture's, in the map which is drawn with
  Products held_ = 0;      // what pictures made stale, held until the light's turn
  FrameClock clock_;
  double back_exposure_ = 1;                    // of the last back picture, as far as it is known
  double drawn_exposure_ = 1;                   // of the last picture that was drawn
  std::shared_ptr<const ShadowMap> kept_gain_;  // its plane gain, where a newer one is to be made
  std::optional<LightMeter> meter_;
  Camera drawn_by_;                   // the last picture
  std::optional<Pose> drawn_from_;    // the last picture
  std::optional<Pose> shown_from_;    // the last picture that showed the object
  std::optional<PictureView> view_;   // of the camera that drew it
  std::optional<PixelTable> pixels_;  // of layers()
};

}  // namespace fastibl
