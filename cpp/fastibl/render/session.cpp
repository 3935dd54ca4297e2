#include "fastibl/render/session.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/clock.h"
#include "fastibl/core/parallel.h"
#include "fastibl/lighting/find_near_lights.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/render/scene_samples.h"
#include "fastibl/render/workload.h"
#include "fastibl/scene/pixel_reader.h"
#include "fastibl/shading/supersample.h"
#include "fastibl/shadow/scene_shadow.h"

namespace fastibl {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Metres: least height of an object's centre for capture, however flat it is.
constexpr double kSmallestHeight = 0.01;

void check_methods(const Methods& methods, const Renderer& renderer) {
  check_settings(methods.diffuse, methods.diffuse_settings);
  check_settings(methods.glossy, methods.glossy_settings);
  check_settings(methods.shadow, methods.shadow_settings);
  check(renderer.has(methods.self_shadow), "the ", renderer.backend(),
        " back end has no self_shadow method ", name(methods.self_shadow),
        "; backend=\"cpu\" has it");
}

Scene checked(Scene scene) {
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
  return scene;
}

Rig checked(Rig rig) {
  rig.validate();
  const Lens lens(rig.back);  // throws where it has none: nothing could be drawn
  return rig;
}

std::shared_ptr<const Environment> checked(std::shared_ptr<const Environment> environment) {
  check(!environment || environment->radiance.size() > 0, "the environment has no map");
  if (environment) environment->validate();
  return environment;
}

std::unique_ptr<Renderer> checked(std::unique_ptr<Renderer> renderer, const SessionOptions& options,
                                  const Camera& camera) {
  check(renderer != nullptr, "a session needs a renderer");
  check_methods(options.methods, *renderer);
  enlarged(camera, options.supersampling);  // throws where it is out of range
  return renderer;
}

// The map holds the light at the object's place, half-way up the object.
CaptureOptions capture_options(const SessionOptions& options, const std::optional<Board>& board,
                               const Scene& scene) {
  CaptureOptions capture;
  capture.size = options.map_size;
  capture.board = board;
  capture.distance = options.distance;
  if (options.methods.capture == CaptureMethod::single && !capture.distance)
    capture.distance = kInfinity;  // as in the paper
  capture.box = options.box;
  capture.prior = options.prior;
  capture.paper_albedo = options.paper_albedo;
  capture.most_boost = options.most_boost;
  capture.doubt_exposures = options.doubt_exposures;
  capture.centre = scene.marker_from_object * glm::dvec3(bounds(scene.mesh.vertices).centre());
  capture.centre.z = std::max(capture.centre.z, kSmallestHeight);
  return capture;
}

// Whether two maps light a scene alike and are known equally well.
bool is_same_light(const Environment& a, const Environment& b) {
  return a.predicted_error == b.predicted_error && a.centre == b.centre && a.box == b.box &&
         a.light_positions == b.light_positions && a.plane_irradiance == b.plane_irradiance &&
         a.radiance == b.radiance;
}

}  // namespace

Session::Session(Scene scene, Rig rig, std::optional<Board> board,
                 std::shared_ptr<const Environment> environment, Detector detector,
                 std::unique_ptr<Renderer> renderer, SessionOptions options)
    : scene_(checked(std::move(scene))),
      rig_(checked(std::move(rig))),
      environment_(checked(std::move(environment))),
      fixed_environment_(environment_ != nullptr),
      renderer_(checked(std::move(renderer), options, rig_.back)),
      options_(std::move(options)),
      tracker_(rig_, board, std::move(detector), options_.follow_surroundings),
      capture_(rig_, capture_options(options_, board, scene_), options_.front_ratio),
      drawn_by_(rig_.back) {
  if (board) meter_.emplace(*board, options_.paper_albedo);
  replan();
}

void Session::replan() {
  stream_.stay();
  judge_anew();
}

void Session::judge_anew() {
  judge_.forget();
  update_plan();
  make_stale();
  if (plan_.includes(PassId::bounce))
    shares_.place_exchange(scene_);  // now rather than in the first frame
}

// What the last picture was put together from is about to be made anew, and stays until the next.
void Session::keep_gain() {
  if (drawn_from_ && !kept_gain_) kept_gain_ = std::make_shared<const ShadowMap>(plane_gain());
}

void Session::forget_drawn() { drawn_from_.reset(), kept_gain_ = nullptr; }

void Session::make_stale() {
  keep_gain();
  // A pass that was left out may come back, and what another method made is out of date.
  for (const PlannedPass& p : plan_.passes) {
    if (!p.included && (p.pass.id == PassId::shadow || p.pass.id == PassId::shade))
      renderer_->clear(p.pass.id);
    if (p.pass.id != PassId::track && p.pass.id != PassId::capture) stale_ |= p.pass.writes;
  }
  shares_.clear(scene_, plan_.methods.self_shadow);
  if (!plan_.includes(PassId::irradiance)) lighting_.reset();  // it may be another method's
}

void Session::choose_methods() {
  const bool hurried = options_.milliseconds > 0;  // one late frame is better than many
  if (judge_.due() && lit() && (options_.error > 0 || hurried)) {
    CandidateOptions choice = candidate_options(scene_, *environment_);
    choice.light_stays = !light_moves(), choice.hurried = hurried;
    choice.offline = options_.offline;
    choice.traced = has(SelfShadowMethod::traced);
    judge_.begin(scene_, {radiance(), near_lights()}, light_summary(), options_.methods,
                 candidates(options_.methods, choice), options_.cast_shadow);
  }
  if (!judge_.step(hurried)) return;
  const Methods before = plan_.methods;
  update_plan(true);
  if (plan_.methods == before) return;
  make_stale();
  time_.restart();
}

// Steps the time budget, but never where the same bits must come out again.
void Session::watch_time(double milliseconds, bool shaded) {
  if (options_.milliseconds == 0 || !options_.adapt) return;
  if (time_.add(milliseconds, plan_.milliseconds, options_.milliseconds, shaded))
    judge_.choose_anew();
}

const Camera& Session::drawn_camera() const {
  const Camera* texture = renderer_->texture_camera();
  return texture ? *texture : rig_.back;
}

bool Session::lit() const { return environment_ && has_light(environment_->radiance); }

bool Session::light_moves() const { return !fixed_environment_ || stream_.moves(); }

void Session::update_plan(bool choose) {
  PlanOptions options;
  options.methods = options_.methods;
  options.track = tracker_.has_board();
  options.capture = !fixed_environment_;
  options.cast_shadow = options_.cast_shadow;
  options.error = options_.error, options.milliseconds = options_.milliseconds;
  options.lighting = lighting_.get();
  options.measured = &judge_.measured();
  options.costs = options_.costs;
  const Camera& drawn = drawn_camera();
  options.workload =
      workload_of(scene_, drawn.width, drawn.height, light_moves(), options_.cast_shadow);
  const auto pixels = [](const Camera& camera) { return double(camera.width) * camera.height; };
  options.workload.cameras = rig_.front ? 2 : 1;
  options.workload.camera_pixels = pixels(rig_.back) + (rig_.front ? pixels(*rig_.front) : 0);
  if (const std::optional<PartCounts> parts = renderer_->parts(); parts && parts->shaded > 0)
    options.object = parts;
  options.slowdown = time_.slowdown();
  options.light_in_turns = in_turns_, options.light_lag = double(light_lag_);
  if (lit() && !judge_.measured().empty())
    options.light_unjudged = judge_.unjudged(light_summary());
  // Under light that stays, the choice must not depend on earlier choices.
  const Methods before = plan_.methods;
  options.settled = !choose && plan_.picture_error;
  if (options.settled || (light_moves() && plan_.picture_error)) options.keep = &before;
  // Those of the pose that the exchange was placed for, which is an earlier choice, too.
  if (const auto groups = shares_.groups(); groups && options.settled)
    options.workload.groups = double(*groups);
  const bool bounced = plan_.includes(PassId::bounce), near_ = plan_.includes(PassId::near_light);
  plan_ = make_plan(scene_, environment_.get(), options);
  // Near lights came to matter, or no longer do.
  if (plan_.includes(PassId::near_light) != near_) {
    shares_.clear_near();
    stale_ |=
        product::near_light | product::bounce | product::plane | product::object | product::image;
  }
  if (plan_.includes(PassId::bounce) == bounced) return;
  keep_gain();
  shares_.clear_bounce();
  stale_ |= product::bounce | product::plane | product::object | product::image;
}

void Session::set_scene(Scene scene) {
  scene_ = checked(std::move(scene));
  forget_drawn();
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
  if (lit() && !light_moves()) judge_.follow_move(light_summary());
  update_plan();  // a lamp may be near from now on
  stale_ |= product::placement;
}
void Session::set_methods(const Methods& methods) {
  check_methods(methods, *renderer_);
  if (methods.capture != options_.methods.capture) {
    capture_.begin_single();
    if (!options_.distance && !options_.box)
      capture_.map().find_distance(methods.capture == CaptureMethod::continuous);
  }
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
  keep_gain();
  renderer_->clear(PassId::shadow);
  replan();
}
void Session::set_shadow_look(const ShadowLook& look) {
  look.validate();
  scene_.shadow_look = look;
  update_plan();
  keep_gain();
  shares_.clear_gain();
  stale_ |= product::plane | product::holdout | product::image;
}
void Session::set_environment(std::shared_ptr<const Environment> environment) {
  environment = checked(std::move(environment));
  // A map that its owner writes to is not known by its address: it is copied.
  if (environment && environment == environment_) {
    environment = std::make_shared<const Environment>(*environment);
  } else if (fixed_environment_ && environment && is_same_light(*environment, *environment_)) {
    stream_.add_same();
    return;
  }
  // Light that is given frame after frame, a little different each time, is treated like captured
  // light: it moves, and visible changes fade. Methods are judged anew where much of it is new.
  std::optional<LightSummary> light;
  if (fixed_environment_ && environment && stream_.follows())
    light = summary_of(environment->radiance);
  const bool little = light && is_little_change(*light, summary_of(environment_->radiance));
  stream_.add(little);
  fixed_environment_ = environment != nullptr;
  if (!little) given_elsewhere_ = false;
  environment_ = std::move(environment);
  if (!stream_.moves()) {  // another place: nothing is to fade
    keep_gain();
    lighting_.reset();
    renderer_->clear(PassId::shadow);
  }
  if (!stream_.moves() || judge_.measured().empty()) return judge_anew();
  judge_.follow(light_summary());
  if (stream_.begins()) judge_.choose_anew();  // what is made for each light costs more now
  update_plan();
  make_stale();
}
void Session::set_renderer(std::unique_ptr<Renderer> renderer) {
  renderer_ = checked(std::move(renderer), options_, rig_.back);
  forget_drawn();
  replan();
}

// No light is taken in turns before there is light, or where there is time for all of it.
void Session::choose_turn(const Frame& frame) {
  const bool continuous = options_.methods.capture == CaptureMethod::continuous;
  in_turns_ = time_.spreads() && continuous && !fixed_environment_ && environment_ && lighting_;
  if (!in_turns_) stale_ |= std::exchange(held_, 0), light_lag_ = 0;
  turns_.next({!frame.front.empty() && rig_.front, !frame.back.empty() && continuous, held_ != 0,
               tracker_.look_due(frame.time)},
              in_turns_);
}

void Session::follow_surroundings(const Frame& frame, FrameResult& result) {
  SeenAround around;
  around.mapped = environment_ != nullptr;
  around.map = [&] { return given_elsewhere_ ? capture_.map().environment() : environment_; };
  const bool given = fixed_environment_ && !given_elsewhere_;
  around.surface = given ? MapSurface(environment_->centre, kInfinity, environment_->box)
                         : capture_.map().surface();
  around.pictures = capture_.pictures(frame);
  around.look = turns_.takes(LightStep::look), around.rarely = in_turns_;
  const std::optional<glm::dmat3> moved = tracker_.follow(frame, std::move(around), result);
  if (!moved) return;
  if (given) {
    // The board did not move: the given light is turned against the place, or of another one.
    given_elsewhere_ = true;
    return;
  }
  capture_.map().turn(*moved);
  result.board_moved = true;
  stale_ |= product::light_pictures;
}

RigCapture::Turn Session::pictures_turn() const {
  return {turns_.takes(LightStep::back), turns_.takes(LightStep::front)};
}

bool Session::wants_capture(const Frame& frame, const FrameResult& found) const {
  return !fixed_environment_ &&
         capture_.wants(frame, found, pictures_turn(), options_.methods.capture, tracker_);
}

std::shared_ptr<const CubeMap> Session::radiance() const {
  return environment_ ? std::shared_ptr<const CubeMap>(environment_, &environment_->radiance)
                      : nullptr;
}

NearLights Session::near_lights() const {
  const bool known = lighting_ && lighting_->radiance.get() == &environment_->radiance;
  const NearLights* before = lighting_ ? &lighting_->near_lights : nullptr;
  return known ? lighting_->near_lights : find_near_lights(*environment_, before);
}

LightSummary Session::light_summary() const {
  LightSummary light = summary_of(environment_->radiance);
  if (!scene_.samples) return light;
  const SceneSamples& samples = *scene_.samples;
  light.nearby =
      near_change(light, near_lights(), samples.centre + shift_of(scene_, samples), samples.radius);
  return light;
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

void Session::ensure_lighting() {
  const std::shared_ptr<const CubeMap> map = radiance();
  if (!lighting_ || lighting_->radiance != map) {
    // No pass reads the irradiance, but the glossy look-up needs its chain. A material that only
    // glows reads nothing.
    Lighting chain;
    if (map) {
      LightingOptions options = lighting_options();
      options.irradiance = false, options.plane = meter_.has_value();
      chain = fit_lighting(map, options, lighting_.get());
    }
    lighting_ = std::make_shared<const Lighting>(std::move(chain));
  } else if (map && !lighting_->chain && reads_chain(lighting_->glossy) &&
             scene_.material.reads_radiance()) {
    Lighting glossy = *lighting_;  // the material was matte when the light was fitted
    fit_chain(glossy);
    lighting_ = std::make_shared<const Lighting>(std::move(glossy));
  }
}

bool Session::shows_back(const Frame& frame) const {
  return !frame.back.empty() || renderer_->texture_camera();
}

// The exposure that the object is drawn with. What comes without a picture holds for its frame
// only.
double Session::exposure_of(const Frame& frame) const {
  return shows_back(frame) ? back_exposure_ : frame.back_exposure.value_or(back_exposure_);
}

void Session::read_exposure(const Frame& frame, const Pose& drawn_from) {
  const bool captured =
      !fixed_environment_ && options_.methods.capture == CaptureMethod::continuous;
  if (captured || !meter_ || frame.back.empty() || frame.back_exposure) return;
  const ByteResponse codes(rig_.back.response);
  const auto shown = meter_->read(PixelReader(frame.back, rig_.back.response, codes), rig_.back,
                                  Lens(rig_.back), drawn_from, 1);
  const glm::dvec3 one(1), falls(lighting_->plane_irradiance);
  if (shown && glm::dot(falls, one) > 0)
    back_exposure_ = glm::dot(*shown, one) / glm::dot(falls, one);
}

// False where the pass had nothing to do.
bool Session::run_pass(PassId id, const Frame& frame, FrameResult& result, const Pose& drawn_from) {
  switch (id) {
    case PassId::track:
      return false;  // ran before: it decides what is due
    case PassId::capture:
      if (!wants_capture(frame, result)) return false;
      if (capture_.add(frame, pictures_turn(), tracker_, result)) tracker_.forget_surroundings();
      if (const auto& taken = result.back_taken; taken && taken->as != TakenAs::left_out)
        back_exposure_ = taken->exposure;
      return true;
    case PassId::mips:
      environment_ = capture_.map().environment(), changes_seen_ = capture_.map().changes_made();
      return true;
    case PassId::irradiance:
      lighting_ = std::make_shared<const Lighting>(
          fit_lighting(radiance(), lighting_options(), lighting_.get()));
      return true;
    case PassId::self_shadow:
      shares_.find_diffuse(scene_, *lighting_);
      return true;
    case PassId::near_light:
      ensure_lighting();  // where nothing reads the irradiance
      shares_.find_near(scene_, *lighting_, plan_.methods.self_shadow);
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
  ensure_lighting();
  if (id == PassId::composite) {
    read_exposure(frame, drawn_from);
    drawn_exposure_ = exposure_of(frame), kept_gain_ = nullptr;
  }
  renderer_->run(id, {scene_, plan_.methods, *lighting_, &drawn_by_, drawn_from, frame.back,
                      exposure_of(frame), shares_.all(), shares_.plane_gain(), shares_.holdouts(),
                      shares_.own(), shares_.near_shares(), &shares_.cell_light(),
                      plan_.shades_alike_as_one, options_.supersampling});
  return true;
}

namespace {

// Runs one of the passes, and records it where it had something to do.
template <typename Body>
void timed(PassId id, FrameResult& result, Body&& body) {
  const Stopwatch watch;
  if (!body()) return;
  result.passes.push_back(id);
  result.timings[std::string(name(id))] += watch.seconds();
}

}  // namespace

void Session::run_passes(const std::vector<PassId>& due, const Frame& frame, FrameResult& result,
                         const Pose& drawn_from) {
  std::size_t next = 0;
  try {
    for (; next < due.size(); ++next)
      timed(due[next], result, [&] { return run_pass(due[next], frame, result, drawn_from); });
  } catch (...) {  // what was not made is still to be made
    for (const PlannedPass& p : plan_.passes)
      if (std::find(due.begin() + std::ptrdiff_t(next), due.end(), p.pass.id) != due.end())
        stale_ |= p.pass.writes;
    throw;
  }
}

bool Session::is_due(PassId id, Products wanted) const {
  Products after = stale_;
  const std::vector<PassId> due = due_passes(plan_, wanted, after);
  return std::find(due.begin(), due.end(), id) != due.end();
}

// Makes the map, and chooses methods for the first light before anything is made of it. Else the
// first picture would be drawn by methods that nobody judged, and the second one by others.
void Session::see_first_light(const Frame& frame, FrameResult& result, const Pose& drawn_from) {
  run_passes(due_passes(plan_, product::radiance, stale_), frame, result, drawn_from);
  choose_methods();
  if (environment_) stale_ &= ~product::radiance;  // no method changes the map
}

Pose Session::pose_of_object(const FrameResult& result) const {
  if (!result.back_last_row) return *result.back_from_marker;
  const glm::vec3 middle = bounds(scene_.mesh.vertices).centre();
  return tracker_.pose_of_row(result, scene_.marker_from_object * glm::dvec3(middle));
}

bool Session::may_show(const Pose& drawn_from) {
  if (!view_ || view_->camera() != drawn_by_) view_.emplace(drawn_by_);
  if (plan_.includes(PassId::shadow)) {
    const PlaneSquare square = farthest_shadow(scene_, plan_.methods.shadow);
    if (view_->may_show(square.centre, square.extent, drawn_from)) return true;
  }
  if (scene_.has_holdouts() && view_->may_show(bounds(scene_.holdouts->mesh.vertices), drawn_from))
    return true;
  return view_->may_show(bounds(scene_.mesh.vertices), drawn_from * scene_.marker_from_object);
}

// Runs the passes that are due. Where light is made in turns, what pictures made stale is held for
// its turn.
void Session::run_due(const Frame& frame, FrameResult& result) {
  const std::optional<Pose>& pose = result.back_from_marker;
  const Pose drawn_from = pose ? pose_of_object(result) : Pose{};
  drawn_from_ = pose && may_show(drawn_from) ? std::optional(drawn_from) : std::nullopt;
  // From a camera that stays, the object looks as before.
  if (drawn_from_ && shown_from_ != drawn_from) stale_ |= product::pose, shown_from_ = drawn_from;
  if (in_turns_ && (stale_ & product::light_pictures)) {
    Products after = stale_;
    const std::vector<PassId> due = due_passes(plan_, product::texels, after);
    held_ |= after & ~stale_, stale_ &= ~product::light_pictures;
    run_passes(due, frame, result, drawn_from);
  }
  const bool lights = in_turns_ && turns_.takes(LightStep::light);
  const std::shared_ptr<const Environment> before = environment_;
  if (lights) stale_ |= std::exchange(held_, 0);
  // Without a pose nothing is drawn, but a front picture with a recent pose still feeds the map,
  // and so do pictures whose rotation the surroundings tell.
  Products wanted = product::texels;
  if (drawn_from_) wanted |= product::image;
  // The caller gets the light also while the camera looks away from the scene. Where the
  // surroundings told by how much it turned, the next rotation is sought in the map as it is now.
  const bool away = tracker_.turned() || (pose && !drawn_from_);
  if (away) wanted |= product::radiance | product::irradiance;
  if (!fixed_environment_ && !lit() && is_due(PassId::mips, wanted))
    see_first_light(frame, result, drawn_from);
  run_passes(due_passes(plan_, wanted, stale_), frame, result, drawn_from);
  if (away && !in_turns_) ensure_lighting();
  if (lights)
    light_lag_ = difference(summary_of(environment_->radiance), summary_of(before->radiance));
}

PictureLayers Session::layers() {
  if (!pixels_ || pixels_->camera != drawn_by_) pixels_.emplace(drawn_by_);
  const ShadowLookUp plane(drawn_from_ ? plane_gain() : ShadowMap{});
  return picture_layers(drawn_exposure_, *pixels_, drawn_from_.value_or(Pose{}), object(), plane,
                        holdout());
}

FrameResult Session::process(const Frame& frame) {
  FrameResult result;
  process(frame, result);
  return result;
}

void Session::process(const Frame& given, FrameResult& result) {
  check_frame(given, rig_);
  Image<std::uint8_t> image = std::move(result.image);  // for its memory
  result = {};
  result.image = std::move(image);
  Frame frame = given;
  frame.time = clock_.at(given.time);
  if (frame.back_exposure && shows_back(frame)) back_exposure_ = *frame.back_exposure;
  using Loops = OneThread::Loops;
  // A time budget counts the processor's time.
  const OneThread loops(options_.milliseconds > 0 ? Loops::alone : Loops::together);
  const Stopwatch total;
  // This thread does all but the search for a lost board and what a graphics driver does.
  const ProcessorClock processor(renderer_->backend() == "cpu" ? ProcessorClock::Of::thread
                                                               : ProcessorClock::Of::process);
  const bool was_lit = lit();

  choose_turn(frame);
  // Tracking decides what else can be done, so it runs by itself.
  timed(PassId::track, result, [&] {
    if (!tracker_.find_pose(frame, options_.methods.tracking, result)) return false;
    follow_surroundings(frame, result);
    return true;
  });
  stale_ |= product::back_picture;
  if (!fixed_environment_ && capture_.map().changes_made() != changes_seen_)  // others were made
    stale_ |= product::light_pictures;
  if (drawn_by_ != drawn_camera()) drawn_by_ = drawn_camera(), shown_from_.reset();
  if (wants_capture(frame, result)) stale_ |= product::light_pictures;
  tracker_.find_motion(frame, result);
  choose_methods();
  run_due(frame, result);

  if (stream_.next_frame()) judge_.judge_anew();  // methods for light that stays
  judge_.add_frame();
  if (!fixed_environment_ && environment_ && judge_.looks()) judge_.follow(light_summary());
  update_plan();  // its errors, now that this frame's light is known
  if (!drawn_from_) renderer_->show(frame.back, drawn_by_);
  if (options_.read_back)
    renderer_->image(result.image);
  else
    result.image = {};
  result.environment = environment_;
  if (lighting_ && lighting_->radiance) result.lighting = lighting_;
  if (environment_) {
    const double method = result.lighting ? lighting_->irradiance_error.value_or(0) : 0.0;
    result.predicted_error = std::hypot(environment_->predicted_error, method);
  }
  result.timings["total"] = total.seconds();
  // In the first light methods are judged, and all that is kept is made.
  if (was_lit) {
    const auto ran = std::find(result.passes.begin(), result.passes.end(), PassId::shade);
    watch_time(1e3 * processor.seconds(), ran != result.passes.end());
  }
}

}  // namespace fastibl
