#include "fastibl/render/session.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "fastibl/core/clock.h"
#include "fastibl/core/parallel.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/render/workload.h"

namespace fastibl {
namespace {

constexpr double kPoseLifetime =
    0.1 + 1e-6;  // seconds that a front picture may use an earlier pose, and times' rounding
// Radians: a rotation by the surroundings that is less sure, drift of the map aside, is not
// captured with; a third of a texel of 128.
constexpr double kMostTurnDeviation = 0.5 * std::numbers::pi / 180;
// Radians: up to here a rotation by a gyroscope tells the least turn of a board from its own error.
constexpr double kSureTurn = 0.3 * std::numbers::pi / 180;
// Seconds between looks around while the board is in view and does not move: where surroundings
// agree with it, and where they do not because they are near, which takes longer to find out.
constexpr double kLookAround = 0.06, kLookAroundNear = 0.25;
constexpr double kLookAroundInTurns = 1;  // seconds: each costs as much as a picture's capture
constexpr double kDoubt = 0.6;  // seconds of disagreeing after which surroundings count as near
// Share of the light that differs when methods are chosen anew.
constexpr float kOtherLight = 0.25f, kOtherCompactLight = 0.05f;
constexpr int kStream = 3;           // frames in a row that come with light of their own
constexpr int kStill = 30;           // frames without, after which it stays again
constexpr int kLeastFrames = 60;     // from one time to the next: it takes as long as some frames
constexpr double kSinglePeriod = 5;  // seconds between the paper's front pictures, which have one
constexpr double kSameExposure = 0.05;   // exposure, by so much of its logarithm; where none comes
constexpr double kSteadyExposure = 0.3;  // ln, from one picture to the next
constexpr double kSinglePatience = 8;    // for so many seconds, another will do
constexpr int kFront = 1;                // the camera's number; the back one's is 0
constexpr double kSmallestHeight =
    0.01;  // metres: an object's centre for capture, however flat it is

}  // namespace

namespace {

void check_methods(const Methods& methods, const Renderer& renderer) {
  check_settings(methods.diffuse, methods.diffuse_settings);
  check_settings(methods.glossy, methods.glossy_settings);
  check_settings(methods.shadow, methods.shadow_settings);
  check(!shares_by_pixel(methods.self_shadow) || renderer.shares_pixels(), "the ",
        renderer.backend(), " back end has no self_shadow method ", name(methods.self_shadow),
        "; backend=\"cpu\" has it");
}

void check_scene(const Scene& scene) {
  check(!scene.mesh.triangles.empty() && scene.normals.size() == scene.mesh.vertices.size(),
        "a session needs a scene with a mesh, as make_scene() makes it");
  check(
      scene.visibility.size() == scene.mesh.vertices.size(),
      "a session needs a scene as make_scene() makes it: of visibility there must be one value for "
      "each vertex, ",
      scene.mesh.vertices.size(), ", got ", scene.visibility.size());
  check_fits(scene.material, scene.mesh);
  scene.marker_from_object.validate();
  scene.shadow_look.validate();
}

void check_environment(const Environment* environment) {
  check(!environment || environment->radiance.size() > 0, "the environment has no map");
}

}  // namespace

Session::Session(Scene scene, Rig rig, std::optional<Board> board,
                 std::shared_ptr<const Environment> environment, Detector detector,
                 std::unique_ptr<Renderer> renderer, SessionOptions options)
    : scene_(std::move(scene)),
      rig_(std::move(rig)),
      board_(std::move(board)),
      environment_(std::move(environment)),
      fixed_environment_(environment_ != nullptr),
      detector_(std::move(detector)),
      renderer_(std::move(renderer)),
      options_(options) {
  check_scene(scene_);
  check_environment(environment_.get());
  rig_.validate();
  const glm::dvec3& ratio = options_.front_ratio;
  check(ratio.x > 0 && ratio.y > 0 && ratio.z > 0 && std::isfinite(ratio.x + ratio.y + ratio.z),
        "a front_ratio must be positive and finite, got ", ratio.x, " ", ratio.y, " ", ratio.z);
  if (board_) board_->validate(), edge_tracker_.emplace(*board_, rig_.back);
  const bool perspective = rig_.back.model == CameraModel::perspective &&
                           (!rig_.front || rig_.front->model == CameraModel::perspective);
  if (board_ && options_.follow_surroundings && perspective) rotation_tracker_.emplace(rig_);
  check(!board_ || detector_, "a session with a board needs a detector");
  check(renderer_ != nullptr, "a session needs a renderer");
  check_methods(options_.methods, *renderer_);
  CaptureOptions capture;
  capture.size = options_.map_size;
  capture.board = board_;
  capture.distance = options_.distance;
  capture.box = options_.box;
  capture.prior = options_.prior;
  capture.paper_albedo = options_.paper_albedo;
  capture.most_boost = options_.most_boost;
  capture.doubt_exposures = options_.doubt_exposures;
  // The map is the light at the object: half-way up, where it stands.
  const Bounds box = bounds(scene_.mesh.vertices);
  capture.centre = scene_.marker_from_object * glm::dvec3(box.centre());
  capture.centre.z = std::max(capture.centre.z, kSmallestHeight);
  capture_.emplace(std::move(capture));
  replan();
}

void Session::replan() {
  set_in_a_row_ = 0;
  judge_anew();
}

void Session::judge_anew() {
  measured_ = {}, measurement_.reset(), measure_due_ = true;
  update_plan();
  make_stale();
  if (plan_.includes(PassId::bounce))
    shares_.place_exchange(scene_);  // now rather than in the first frame
}

void Session::make_stale() {
  // What was left out may come back, and what was made by another method is old.
  for (const PlannedPass& p : plan_.passes) {
    if (!p.included && (p.pass.id == PassId::shadow || p.pass.id == PassId::shade))
      renderer_->clear(p.pass.id);
    if (p.pass.id != PassId::track && p.pass.id != PassId::capture) stale_ |= p.pass.writes;
  }
  shares_.clear(scene_, plan_.methods.self_shadow);
  if (!plan_.includes(PassId::irradiance)) lighting_.reset();  // it may be another method's
}

namespace {

constexpr int kCoarse = 16;    // texels along a face that light is summed up by
constexpr float kCompact = 8;  // times the mean radiance, from where on light is compact

LightSummary summary_of(const CubeMap& map) {
  LightSummary light;
  const CubeLevel& top = map.level(map.level_count() - 1);
  glm::vec3 mean(0);
  for (int f = 0; f < 6; ++f) mean += (light.faces[std::size_t(f)] = top.texel(f, 0, 0)) / 6.0f;
  const CubeLevel& level = map.level_at_most(kCoarse);
  const float all = mean.x + mean.y + mean.z, limit = kCompact * all;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < level.size(); ++y)
      for (int x = 0; x < level.size(); ++x) {
        const glm::vec3 texel = level.texel(f, x, y);
        light.compact += std::max(texel.x + texel.y + texel.z - limit, 0.0f);
      }
  const float texels = 6.0f * float(level.size()) * float(level.size());
  light.compact = all > 0 ? light.compact / (texels * all) : 0;
  return light;
}

// By so much of its light the map differs from another, face by face.
float difference(const LightSummary& a, const LightSummary& b) {
  float off = 0, all = 0;
  for (std::size_t f = 0; f < a.faces.size(); ++f)
    for (int c = 0; c < 3; ++c)
      off += std::abs(a.faces[f][c] - b.faces[f][c]), all += std::max(a.faces[f][c], b.faces[f][c]);
  return all > 0 ? off / all : 0;
}

// Whether what was measured by one map says little of another. A small lamp hardly changes its
// face, but all of the shadow.
bool is_other_light(const LightSummary& a, const LightSummary& b) {
  return difference(a, b) > kOtherLight || std::abs(a.compact - b.compact) > kOtherCompactLight;
}

// Whether two maps light a scene alike, and are as well known; never where lights have places.
bool is_same_light(const Environment& a, const Environment& b) {
  return a.predicted_error == b.predicted_error && a.centre == b.centre && !a.box && !b.box &&
         a.light_positions.empty() && b.light_positions.empty() &&
         a.plane_irradiance == b.plane_irradiance && a.radiance == b.radiance;
}

}  // namespace

void Session::choose_methods() {
  if (measure_due_ && environment_ && (options_.error > 0 || options_.milliseconds > 0)) {
    measure_due_ = false, since_measured_ = 0;
    const auto radiance = std::shared_ptr<const CubeMap>(environment_, &environment_->radiance);
    CandidateOptions choice = candidate_options(scene_, *environment_);
    choice.light_stays = !light_moves(), choice.hurried = options_.milliseconds > 0;
    choice.offline = options_.offline, choice.by_pixel = renderer_->shares_pixels();
    measurement_.emplace(scene_, scene_.samples.get(), radiance, options_.methods,
                         candidates(options_.methods, choice), options_.cast_shadow);
    measured_light_ = summary_of(environment_->radiance);
  }
  if (measurement_) {
    // At once where there is nothing to choose by, or one late frame is better than many; else a
    // step in each frame.
    const OneThread loops(OneThread::Loops::together);
    const bool at_once = measured_.empty() || options_.milliseconds > 0;
    try {
      do measurement_->step();
      while (at_once && !measurement_->done());
    } catch (...) {  // of half a judgement nothing can be made
      measurement_.reset(), measure_due_ = true;
      throw;
    }
    if (measurement_->done())
      measured_ = measurement_->errors(), measurement_.reset(), choose_due_ = true;
  }
  if (!choose_due_) return;
  choose_due_ = false;
  if (measured_.empty()) return;
  const Methods before = plan_.methods;
  update_plan(true);
  if (plan_.methods == before) return;
  make_stale();
  time_.restart();
}

// Steps of the time budget; never where the same bits are to come again.
void Session::watch_time(double milliseconds) {
  if (options_.milliseconds == 0 || !options_.adapt) return;
  if (time_.add(milliseconds, plan_.milliseconds, options_.milliseconds)) choose_due_ = true;
}

bool Session::light_moves() const { return !fixed_environment_ || set_in_a_row_ >= kStream; }

void Session::update_plan(bool choose) {
  PlanOptions options;
  options.methods = options_.methods;
  options.track = board_.has_value();
  options.capture = !fixed_environment_;
  options.cast_shadow = options_.cast_shadow;
  options.error = options_.error, options.milliseconds = options_.milliseconds;
  options.lighting = lighting_.get();
  options.measured = &measured_;
  options.costs = options_.costs;
  options.workload =
      workload_of(scene_, rig_.back.width, rig_.back.height, light_moves(), options_.cast_shadow);
  if (const auto groups = shares_.groups()) options.workload.groups = double(*groups);
  if (const std::optional<double> pixels = renderer_->shaded(); pixels && *pixels > 0)
    options.object_pixels = pixels;
  options.slowdown = time_.slowdown();
  options.light_in_turns = in_turns_, options.light_lag = double(light_lag_);
  // Of light that stays, what is chosen must not depend on what was before.
  const Methods before = plan_.methods;
  options.settled = !choose && plan_.picture_error;
  if (options.settled || (light_moves() && plan_.picture_error)) options.keep = &before;
  const bool bounced = plan_.includes(PassId::bounce), near_ = plan_.includes(PassId::near_light);
  plan_ = make_plan(scene_, environment_.get(), options);
  // The light came to matter, or no longer does.
  if (plan_.includes(PassId::near_light) != near_) {
    shares_.clear_near();
    stale_ |=
        product::near_light | product::bounce | product::plane | product::object | product::image;
  }
  if (plan_.includes(PassId::bounce) == bounced) return;
  shares_.clear_bounce();
  stale_ |= product::bounce | product::plane | product::object | product::image;
}

void Session::set_scene(Scene scene) {
  check_scene(scene);
  scene_ = std::move(scene);
  shares_.forget_object();
  renderer_->clear(PassId::shadow), renderer_->clear(PassId::shade);
  replan();
}
void Session::set_material(const Material& material) {
  check_fits(material, scene_.mesh);
  scene_.material = material;
  replan();
}
void Session::move(const Pose& marker_from_object) {
  marker_from_object.validate();
  scene_.marker_from_object = marker_from_object;
  update_plan();  // a lamp may be near from now on
  stale_ |= product::placement;
}
void Session::set_methods(const Methods& methods) {
  check_methods(methods, *renderer_);
  if (methods.capture != options_.methods.capture) last_capture_time_.reset();
  options_.methods = methods;
  replan();
}
void Session::set_budgets(double error, double milliseconds) {
  check_budgets(error, milliseconds);
  options_.error = error, options_.milliseconds = milliseconds;
  time_ = {};
  replan();
}
void Session::set_cast_shadow(bool cast) {
  options_.cast_shadow = cast;
  replan();
}
void Session::set_baked_shadow(std::shared_ptr<const MeshShadow> baked) {
  if (baked == scene_.baked_shadow) return;
  scene_.baked_shadow = std::move(baked);
  renderer_->clear(PassId::shadow);
  replan();
}
void Session::set_shadow_look(const ShadowLook& look) {
  look.validate();
  scene_.shadow_look = look;
  update_plan();
  shares_.clear_gain();
  stale_ |= product::plane | product::holdout | product::image;
}
void Session::set_environment(std::shared_ptr<const Environment> environment) {
  check_environment(environment.get());
  // A map that is kept and written to is not known by its address: it is copied.
  if (environment && environment == environment_)
    environment = std::make_shared<const Environment>(*environment);
  else if (fixed_environment_ && environment && is_same_light(*environment, *environment_)) {
    since_set_ = 0;
    return;
  }
  // Light that comes frame after frame, a little other each time, is taken as captured light is: it
  // moves, and what can be seen of that fades; methods are judged anew where much of it is new.
  bool little = false, judged = false;
  if (fixed_environment_ && environment && since_set_ == 1) {
    const LightSummary light = summary_of(environment->radiance);
    little = difference(light, summary_of(environment_->radiance)) <= kOtherLight;
    judged = !measured_.empty() && !measure_due_ && !is_other_light(light, *measured_light_);
  }
  set_in_a_row_ = little ? set_in_a_row_ + 1 : 0, since_set_ = 0, since_new_ = 0;
  const bool moves = set_in_a_row_ >= kStream;
  fixed_environment_ = environment != nullptr;
  if (!little) given_elsewhere_ = false;
  environment_ = std::move(environment);
  if (!moves) {  // another place: nothing is to fade
    lighting_.reset();
    renderer_->clear(PassId::shadow);
  }
  if (!moves || measured_.empty()) return judge_anew();
  if (!judged && !measurement_) measure_due_ = true;
  if (set_in_a_row_ == kStream) choose_due_ = true;  // what is made for each light costs more now
  update_plan();
  make_stale();
}
void Session::set_renderer(std::unique_ptr<Renderer> renderer) {
  check(renderer != nullptr, "a session needs a renderer");
  check_methods(options_.methods, *renderer);
  renderer_ = std::move(renderer);
  replan();
}

std::optional<Pose> Session::find_pose(const Frame& frame, FrameResult& result) {
  if (frame.back.empty()) return std::nullopt;
  const TrackingMethod method = options_.methods.tracking;
  if (method == TrackingMethod::automatic || method == TrackingMethod::edges) {
    MotionHint hint;
    if (frame.attitude && tracked_attitude_)
      hint.turn = *frame.attitude * glm::transpose(*tracked_attitude_);
    result.tracked = edge_tracker_->track(frame.back, frame.time, detector_, hint);
    if (!result.tracked) return std::nullopt;
    tracked_attitude_ = frame.attitude;
    return result.tracked->camera_from_marker;
  }
  edge_tracker_->reset();
  TrackingOptions options;
  options.method = method;
  const Image<std::uint8_t> grey = grey_from(frame.back, rig_.back.response);
  result.tracked = track(detector_, grey.view(), *board_, rig_.back, options);
  if (!result.tracked) return std::nullopt;
  return result.tracked->camera_from_marker;
}

// Where the board is in view: whether it lies where it lay. Where it is not: how the cameras
// turned.
void Session::follow_surroundings(const Frame& frame, FrameResult& result) {
  RigPictures pictures;  // what is of unknown exposure cannot be compared
  pictures.number = ++moments_;
  if (const auto exposure = frame.back_exposure ? frame.back_exposure : read_back_.next())
    pictures.back = frame.back, pictures.back_exposure = *exposure;
  if (const auto exposure = frame.front_exposure ? frame.front_exposure : read_front_.next()) {
    pictures.front = frame.front;
    pictures.front_exposure = *exposure * options_.front_ratio.y;  // compared is green
  }
  if (!rotation_tracker_) return;
  const auto start = [&](const Pose& pose) {
    rotation_tracker_->start(pose, frame.time, pictures);
    known_attitude_ = frame.attitude;
  };
  const auto track = [&] {
    std::optional<glm::dmat3> turn;
    if (frame.attitude && known_attitude_)
      turn = *frame.attitude * glm::transpose(*known_attitude_);
    known_attitude_ = frame.attitude;
    const auto around = given_elsewhere_ ? capture_->environment() : environment_;
    return rotation_tracker_->track(*around, pictures, frame.time, turn);
  };
  if (!environment_) {
    // Before there is a map there is a pose to start from.
    if (result.tracked) start(*result.back_from_marker);
    return;
  }
  if (!result.tracked) {
    // A front picture alone has the last pose for a while.
    if (frame.back.empty() && last_pose_ && frame.time - last_pose_time_ <= kPoseLifetime) return;
    if (between_looks_) {
      rotation_tracker_->start(between_looks_->pose, between_looks_->time);
      known_attitude_ = between_looks_->attitude;
    }
    between_looks_.reset();
    result.turned = track();
    if (result.turned && result.turned->own_deviation() < kMostTurnDeviation)
      turned_ = result.turned->back_from_marker;
    return;
  }
  const Pose& pose = *result.back_from_marker;
  if (!board_motion_.moving() && !turns_.takes(LightStep::look)) {
    between_looks_ = {pose, frame.time, frame.attitude};
    return;
  }
  between_looks_.reset();  // by the board: whether it lies still is the question
  const Agreement agreement = rotation_tracker_->compare(pose.rotation, pictures);
  std::optional<Turned> around;
  if (agreement == Agreement::differs || (agreement == Agreement::nothing && frame.attitude))
    around = track();
  board_motion_.look(pose, agreement, around, frame.time);
  if (agreement != Agreement::differs) agreed_ = frame.time;
  look_again_ = frame.time - 1e-6 +
                (in_turns_                       ? kLookAroundInTurns
                 : frame.time - agreed_ < kDoubt ? kLookAround
                                                 : kLookAroundNear);
  hold_capture_ = board_motion_.moving();
  if (const std::optional<glm::dmat3> moved = board_motion_.moved()) {
    if (fixed_environment_ && !given_elsewhere_) {
      // Not the board: what was given is turned against the place, or of another one.
      given_elsewhere_ = true;
      rotation_tracker_->forget();
      return start(pose);
    }
    capture_->turn(*moved);
    rotation_tracker_->forget();
    result.board_moved = true;
    stale_ |= product::light_pictures;
  }
  // By a gyroscope a board is seen to turn slowly, too, if it is not asked anew each time.
  const bool told = frame.attitude && around && around->own_deviation() < kSureTurn;
  if (board_motion_.moving()) return;
  if (told && !result.board_moved)
    between_looks_ = {pose, frame.time, frame.attitude};
  else
    start(pose);
}

// Before there is light, or where there is time for all, none is taken in turns.
void Session::choose_turn(const Frame& frame) {
  const bool continuous = options_.methods.capture == CaptureMethod::continuous;
  in_turns_ = time_.spreads() && continuous && !fixed_environment_ && environment_ && lighting_;
  if (!in_turns_) stale_ |= std::exchange(held_, 0), light_lag_ = 0;
  turns_.next({!frame.front.empty() && rig_.front, !frame.back.empty() && continuous, held_ != 0,
               rotation_tracker_ && frame.time >= look_again_},
              in_turns_);
}

bool Session::wants_capture(const Frame& frame, const std::optional<Pose>& pose) const {
  if (fixed_environment_) return false;
  if (hold_capture_) return false;
  const bool front_usable =
      turns_.takes(LightStep::front) &&
      (pose || turned_ ||
       (frame.back.empty() && last_pose_ && frame.time - last_pose_time_ <= kPoseLifetime));
  if (options_.methods.capture == CaptureMethod::continuous)
    return front_usable || ((pose || turned_) && turns_.takes(LightStep::back));
  if (!front_usable || !last_capture_time_) return front_usable;
  const double since = frame.time - *last_capture_time_;
  return since >= kSinglePeriod && (since >= kSinglePatience || is_single_exposure(frame));
}

// Whether a front picture has the exposure of the first that was captured.
bool Session::is_single_exposure(const Frame& frame) const {
  if (!frame.front_exposure || !single_exposure_) return !frame.front_exposure && !single_exposure_;
  return std::abs(std::log(*frame.front_exposure / *single_exposure_)) <= kSameExposure;
}

// The rows' motion as tracked or given, or else that of the last frames.
void Session::find_motion(const Frame& frame, FrameResult& result) {
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

Pose Session::drawn_pose(const FrameResult& result) const {
  const Pose& first = *result.back_from_marker;
  if (!result.back_last_row) return first;
  const RowMotion motion = motion_between(first, *result.back_last_row);
  const Pose middle = motion.moved(first, 0.5);
  const auto pixel = rig_.back.project(middle * capture_->centre());
  const double share = pixel ? std::clamp(pixel->y / rig_.back.height, 0.0, 1.0) : 0.5;
  return motion.moved(first, share);
}

void Session::ReadExposure::read(const Taken& taken) {
  std::optional<double> now;
  if (taken.as != TakenAs::left_out) now = taken.exposure;
  steady = now && last && std::abs(std::log(*now / *last)) <= kSteadyExposure;
  last = now;
}

void Session::capture_frame(const Frame& frame, FrameResult& result) {
  const std::optional<Pose>& pose = result.back_from_marker;
  // Of what only turned, the place is not known: the plane that was seen from the board's pose
  // stays as it was.
  const bool plane = pose || !turned_;
  if ((pose || turned_) && turns_.takes(LightStep::back)) {
    result.back_taken =
        capture_->add(frame.back, rig_.back, pose ? *pose : *turned_, frame.back_exposure,
                      frame.time, {}, result.back_last_row, glm::dvec3(1), plane);
    if (result.back_taken->as != TakenAs::left_out) back_exposure_ = result.back_taken->exposure;
    read_back_.read(*result.back_taken);
    const int before = std::exchange(mended_, capture_->mended());
    if (mended_ != before && rotation_tracker_)
      rotation_tracker_->forget();  // what pictures showed was in another scale
  }
  if (turns_.takes(LightStep::front)) {
    const auto front_from_marker = [&](double time) {
      if (!plane) return rig_.front_from_back * *turned_;
      const double later = time - last_pose_time_;
      return rig_.front_from_back *
             (motion_ && later > 0 ? motion_->later(*last_pose_, later) : *last_pose_);
    };
    std::optional<Pose> last_row;
    if (plane && rig_.front->readout > 0)
      last_row = front_from_marker(frame.time + rig_.front->readout);
    result.front_taken =
        capture_->add(frame.front, *rig_.front, front_from_marker(frame.time), frame.front_exposure,
                      frame.time, {}, last_row, options_.front_ratio, plane, kFront);
    read_front_.read(*result.front_taken);
    if (result.front_taken->as == TakenAs::left_out) return;
    if (!last_capture_time_ || !is_single_exposure(frame)) single_exposure_ = frame.front_exposure;
    last_capture_time_ = frame.time;
  }
}

LightingOptions Session::lighting_options() const {
  LightingOptions options;
  options.diffuse = plan_.methods.diffuse;
  options.diffuse_settings = plan_.methods.diffuse_settings;
  options.glossy = plan_.methods.glossy;
  options.glossy_settings = plan_.methods.glossy_settings;
  options.normalization = plan_.methods.normalization;
  options.chain = scene_.material.reads_radiance();
  options.follows = true;
  options.environment = environment_.get();
  return options;
}

// Runs a pass; false where it had nothing to do.
bool Session::run_pass(PassId id, const Frame& frame, FrameResult& result, const Pose& drawn_from) {
  const auto radiance = [&] {  // null before there is a map: what only glows reads none
    return environment_ ? std::shared_ptr<const CubeMap>(environment_, &environment_->radiance)
                        : nullptr;
  };
  switch (id) {
    case PassId::track:
      return false;  // ran before: it decides what is due
    case PassId::capture:
      if (!wants_capture(frame, result.back_from_marker)) return false;
      capture_frame(frame, result);
      return true;
    case PassId::mips:
      environment_ = capture_->environment();
      return true;
    case PassId::irradiance:
      lighting_ = std::make_shared<const Lighting>(
          fit_lighting(radiance(), lighting_options(), lighting_.get()));
      return true;
    case PassId::self_shadow:
      shares_.find_diffuse(scene_, *lighting_);
      return true;
    case PassId::near_light:
      shares_.find_near(scene_, *lighting_, plan_.includes(PassId::self_shadow));
      return true;
    case PassId::bounce:
      shares_.find_bounce(scene_, *lighting_, renderer_->shadow_map());
      return true;
    case PassId::plane:
      shares_.find_plane_gain(scene_, renderer_->shadow_map());
      return true;
    case PassId::holdout:
      shares_.find_holdouts(scene_, *lighting_);
      return true;
    case PassId::shade:
      shares_.find_glossy(scene_, radiance().get(), plan_.methods.self_shadow, drawn_from);
      break;
    default:
      break;
  }
  if (lighting_ && lighting_->radiance == radiance() && radiance() && !lighting_->chain &&
      reads_chain(lighting_->glossy) && scene_.material.reads_radiance()) {
    Lighting glossy = *lighting_;  // the material was matte when the light was fitted
    fit_chain(glossy);
    lighting_ = std::make_shared<const Lighting>(std::move(glossy));
  }
  if (!lighting_ || lighting_->radiance != radiance()) {
    Lighting chain;  // no pass reads the irradiance, but the glossy look-up needs its chain
    if (radiance()) {
      LightingOptions options = lighting_options();
      options.irradiance = false;
      chain = fit_lighting(radiance(), options, lighting_.get());
    }
    lighting_ = std::make_shared<const Lighting>(std::move(chain));
  }
  renderer_->run(id, {scene_, plan_.methods, *lighting_, rig_.back, drawn_from, frame.back,
                      back_exposure_, shares_.all(), shares_.plane_gain(), shares_.holdouts(),
                      shares_.own(), &shares_.cell_light(), plan_.shades_alike_as_one});
  return true;
}

FrameResult Session::process(const Frame& frame) {
  check_frame(frame, rig_);
  check(!last_time_ || frame.time >= *last_time_, "time must not run backwards: ", frame.time,
        " s after ", last_time_.value_or(0), " s");
  last_time_ = frame.time;
  if (frame.back_exposure) back_exposure_ = *frame.back_exposure;
  using Loops = OneThread::Loops;
  // A time budget counts the processor's time.
  const OneThread loops(options_.milliseconds > 0 ? Loops::alone : Loops::together);
  const Stopwatch total;
  const ProcessorClock processor;
  FrameResult result;
  const auto timed = [&](PassId id, auto&& body) {
    const Stopwatch watch;
    if (!body()) return;  // had nothing to do
    result.passes.push_back(id);
    result.timings[std::string(name(id))] += watch.seconds();
  };

  choose_turn(frame);
  turned_.reset(), hold_capture_ = false;
  // Tracking decides what else can be done, so it runs by itself; a given pose stands in for it.
  if (frame.back_from_marker || !board_)
    result.back_from_marker = frame.back_from_marker;
  else
    timed(PassId::track, [&] {
      result.back_from_marker = find_pose(frame, result);
      follow_surroundings(frame, result);
      return true;
    });
  const std::optional<Pose>& pose = result.back_from_marker;
  stale_ |= product::back_picture | product::pose;
  if (wants_capture(frame, pose)) stale_ |= product::light_pictures;
  if (pose) find_motion(frame, result);
  const Pose drawn_from = pose ? drawn_pose(result) : Pose{};

  choose_methods();
  Products wanted = product::texels;
  // Without a pose nothing is drawn, but a front picture with a recent pose still feeds the map,
  // and so do pictures whose rotation the surroundings tell.
  if (pose) wanted |= product::image;
  const auto run = [&](const std::vector<PassId>& due) {
    std::size_t next = 0;
    try {
      for (; next < due.size(); ++next)
        timed(due[next], [&] { return run_pass(due[next], frame, result, drawn_from); });
    } catch (...) {  // what was not made is still to be made
      for (const PlannedPass& p : plan_.passes)
        if (std::find(due.begin() + std::ptrdiff_t(next), due.end(), p.pass.id) != due.end())
          stale_ |= p.pass.writes;
      throw;
    }
  };
  if (in_turns_ && (stale_ & product::light_pictures)) {
    Products after = stale_;
    const std::vector<PassId> due = due_passes(plan_, product::texels, after);
    held_ |= after & ~stale_, stale_ &= ~product::light_pictures;
    run(due);
  }
  const bool lights = in_turns_ && turns_.takes(LightStep::light);
  const std::shared_ptr<const Environment> before = environment_;
  if (lights) stale_ |= std::exchange(held_, 0);
  run(due_passes(plan_, wanted, stale_));
  if (lights)
    light_lag_ = difference(summary_of(environment_->radiance), summary_of(before->radiance));
  ++since_measured_, ++since_set_, ++since_new_;
  if (set_in_a_row_ >= kStream && since_new_ >= kStill)  // methods for light that stays
    set_in_a_row_ = 0, measure_due_ = true;
  if (!fixed_environment_ && environment_)
    measure_due_ = measure_due_ || !measured_light_ ||
                   (since_measured_ >= kLeastFrames &&
                    is_other_light(summary_of(environment_->radiance), *measured_light_));
  update_plan();  // its errors, now that this frame's light is known
  if (pose)
    result.image = renderer_->image();
  else if (!frame.back.empty())
    result.image = bytes_from(frame.back, rig_.back.response);
  else
    result.image = Image<std::uint8_t>(rig_.back.width, rig_.back.height, 4);
  result.environment = environment_;
  if (lighting_ && lighting_->radiance) result.lighting = lighting_;
  if (environment_) {
    const double method = result.lighting ? lighting_->irradiance_error.value_or(0) : 0.0;
    result.predicted_error = std::hypot(environment_->predicted_error, method);
  }
  result.timings["total"] = total.seconds();
  watch_time(1e3 * processor.seconds());
  return result;
}

}  // namespace fastibl
