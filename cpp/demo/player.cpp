#include "demo/player.h"

#include <cstdio>
#include <iostream>
#include <utility>

#include "demo/object.h"
#include "demo/open.h"
#include "fastibl/core/check.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/tracking/opencv/opencv_detector.h"

namespace fastibl::demo {
namespace {

constexpr double kNew = 3;  // seconds for which a message is shown
// A person who watches and has set no time budget should not see slow motion: a mirror within 2 %
// may take most of a second a frame.
constexpr double kSlow = 0.15;       // seconds per frame
constexpr int kSlowFrames = 5;       // in a row
constexpr double kQuickEnough = 50;  // milliseconds, the budget that is set then

}  // namespace

Player::Player(const Args& args, bool live)
    : args_(args),
      live_(live),
      source_(open_source(args)),
      objects_(args.objects, args.z_up),
      object_(args.objects.empty() ? objects_.names()[0] : args.objects[0].string()),
      backend_(args.backend),
      height_(args.height),
      board_(board_for(args, *source_)) {
  for (const std::string& name : args.overlays)
    for (std::size_t k = 0; k < kOverlays.size(); ++k)
      if (kOverlays[k].name == name) overlays_[k] = true;
  make_session(make_object(objects_.mesh(object_), height_));
  if (!args.material_name.empty()) set_material(args.material_name);
  if (!args.record.empty()) begin_recording(args.record);
}

Scene Player::make_object(Mesh mesh, double height) const {
  SceneOptions options;
  options.bake_shadow = true;
  return make_scene(stand(std::move(mesh), height), args_.material, Pose(), options);
}

std::unique_ptr<Renderer> Player::make_renderer() {
  try {
    return demo::make_renderer(backend_);
  } catch (const std::runtime_error& error) {  // no driver
    std::cerr << "fastibl-demo: " << error.what() << "; going on with the back end cpu\n";
    say("no " + backend_ + " back end here; going on with cpu");
    backend_ = "cpu";
    return demo::make_renderer(backend_);
  }
}

void Player::make_session(Scene scene) {
  SessionOptions options;
  options.methods = args_.paper ? Methods::paper() : Methods{};
  options.error = args_.error, options.milliseconds = args_.milliseconds;
  options.cast_shadow = args_.cast_shadow;
  options.supersampling = args_.supersampling;
  scene.shadow_look = args_.shadow_look;
  session_ = std::make_unique<Session>(std::move(scene), source_->rig(), board_, nullptr,
                                       opencv_detector(), make_renderer(), options);
}

bool Player::advance() {
  adopt_object();
  const Stopwatch taking;
  std::optional<OwnedFrame> next = source_->next();
  if (!next) return false;
  timings_.add("source", taking.seconds());
  frame_ = std::make_shared<const OwnedFrame>(std::move(*next));
  ++count_;
  record_frame();
  FrameResult result = session_->process(frame_->view());
  timings_.add(result.timings);
  watch_time(result);
  // A frame with a front picture alone only feeds the map; there is nothing to show.
  if (frame_->back.empty()) {
    if (result.environment) result_.environment = result.environment;  // none yet after a change
    return true;
  }
  shown_ = frame_, changed_ = false;
  result_ = std::move(result);
  tracked_ = result_.tracked;
  if (!result_.back_from_marker) ++unseen_;
  drawn_ = false;
  return true;
}

void Player::watch_time(const FrameResult& result) {
  if (!live_ || options().milliseconds > 0 || options().error == 0) return;
  const double seconds = result.timings.at("total");
  slow_ = seconds > kSlow ? slow_ + 1 : 0;
  if (slow_ < kSlowFrames || hurried_) return;
  hurried_ = true;  // only once: a user who then asks for no budget gets none
  char text[96];
  std::snprintf(text, sizeof text, "%.0f ms a frame for %g %%: methods are now chosen for %g ms",
                1000 * seconds, 100 * options().error, kQuickEnough);
  set_budgets(options().error, kQuickEnough);
  say(text);
}

// Draws the frame again with what was changed. The map stays as it is, because a picture counts
// only once.
void Player::refresh() {
  adopt_object();
  if (!changed_ || !shown_) return;
  changed_ = drawn_ = false;
  if (!result_.back_from_marker || !result_.environment) return;
  Frame frame = shown_->view();
  frame.time = frame_->time;  // front pictures may have come since
  frame.front = {}, frame.back_from_marker = result_.back_from_marker;
  frame.back_last_row = result_.back_last_row;
  session_->set_environment(result_.environment);
  try {
    result_ = session_->process(frame);
  } catch (...) {
    session_->set_environment(nullptr);
    throw;
  }
  session_->set_environment(nullptr);
  result_.tracked = tracked_;
}

const Image<std::uint8_t>& Player::picture() {
  if (drawn_ || result_.image.empty()) return picture_;
  drawn_ = true;
  picture_ = result_.image;
  const Stopwatch drawing;
  Canvas canvas(picture_);
  const std::shared_ptr<const CubeMap> truth = source_->true_light();
  const View view{source_->rig(), board_, *shown_, result_, *session_, timings_, truth.get()};
  bool any = false;
  for (std::size_t k = 0; k < kOverlays.size(); ++k)
    if (overlays_[k]) kOverlays[k].draw(canvas, view), any = true;
  if (any) timings_.add("overlays", drawing.seconds());
  return picture_;
}

// If several objects are asked for while one is being made, the last one counts.
void Player::wish_for_object(const std::string& name, double height) {
  coming_name_ = name, coming_height_ = height;
  again_ = live_ && coming_.valid();
  if (!again_) begin_object();
}

void Player::begin_object() {
  again_ = false;
  say("making " + coming_name_);
  coming_ = std::async(live_ ? std::launch::async : std::launch::deferred,
                       [this, name = coming_name_, height = coming_height_] {
                         return make_object(objects_.mesh(name), height);
                       });
}

void Player::adopt_object() {
  if (!coming_.valid()) return;
  if (live_ && coming_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
  try {
    Scene scene = coming_.get();
    if (!again_) show_object(std::move(scene));
  } catch (const std::exception& error) {
    if (!again_) told_or_thrown(error);
  }
  if (again_) begin_object();
}

void Player::show_object(Scene scene) {
  scene.material = session_->scene().material;
  scene.shadow_look = session_->scene().shadow_look;
  check_fits(scene.material, scene.mesh);
  session_->set_scene(std::move(scene));
  object_ = coming_name_, height_ = coming_height_;
  objects_.add(object_);
  turn(0);
  say(object_ + ", " + std::to_string(std::lround(100 * height_)) + " cm high");
  changed_ = true;
}

void Player::set_object(const std::string& name) {
  wish_for_object(name, coming_.valid() ? coming_height_ : height_);
}
void Player::set_height(double metres) {
  check(metres >= 0.01 && metres <= 2, "the height must be from 0.01 to 2 m, got ", metres);
  wish_for_object(coming_.valid() ? coming_name_ : object_, metres);
}
void Player::set_material(const std::string& name) {
  session_->set_material(material_named(name, args_.material));
  material_ = name, changed_ = true;
}
void Player::turn(double degrees) {
  turned_ = std::remainder(turned_ + degrees, 360);
  Pose pose;
  pose.rotation = rotation_from_vector({0, 0, turned_ * kDegree});
  session_->move(pose);
  changed_ = true;
}
void Player::set_cast_shadow(bool cast) { session_->set_cast_shadow(cast), changed_ = true; }
void Player::set_shadow_strength(double strength) {
  ShadowLook look = session_->scene().shadow_look;
  look.strength = float(strength);
  session_->set_shadow_look(look);
  changed_ = true;
}
void Player::set_methods(const Methods& methods) {
  session_->set_methods(methods), changed_ = true;
}
void Player::set_backend(const std::string& name) {
  const std::string before = std::exchange(backend_, name);
  try {
    session_->set_renderer(make_renderer());
  } catch (...) {  // the renderer lacks a method that is asked for
    backend_ = before;
    throw;
  }
  changed_ = true;
}
void Player::set_budgets(double error, double milliseconds) {
  session_->set_budgets(error, milliseconds), changed_ = true;
}
void Player::set_overlay(std::size_t index, bool on) { overlays_[index] = on, drawn_ = false; }

void Player::set_recording(bool on, const std::filesystem::path& path) {
  if (on == recording()) return;
  try {
    if (on) {
      std::filesystem::path folder = path.empty() ? "fastibl-recording" : path;
      for (int k = 2; path.empty() && std::filesystem::exists(folder); ++k)
        folder = "fastibl-recording-" + std::to_string(k);
      return begin_recording(folder);
    }
    const std::unique_ptr<Recorder> ending = std::move(recorder_);
    ending->close();
    say("recorded " + std::to_string(ending->written()) + " frames to " + ending->path().string() +
        (ending->dropped() ? ", " + std::to_string(ending->dropped()) + " found no room" : ""));
  } catch (const std::exception& error) {
    recorder_.reset();
    told_or_thrown(error);
  }
}

void Player::begin_recording(const std::filesystem::path& folder) {
  recorder_ = std::make_unique<Recorder>(folder, source_->rig(), board_);
  say("recording to " + folder.string());
}

void Player::record_frame() {
  if (!recorder_) return;
  try {
    recorder_->add(frame_, !source_->live());
  } catch (const std::exception& error) {
    recorder_.reset();
    told_or_thrown(error);
  }
}

void Player::restart() {
  if (!source_->live()) {
    std::unique_ptr<FrameSource> again = open_source(args_);  // if it throws, the old one stays
    set_recording(false);                                     // because time begins again
    source_ = std::move(again);
  }
  begin_session();
  result_ = {};
  say("beginning again");
}

// Begins a session with the present settings, but without the map.
void Player::begin_session() {
  Scene scene = session_->scene();
  const SessionOptions options = session_->options();
  session_ = std::make_unique<Session>(std::move(scene), source_->rig(), board_, nullptr,
                                       opencv_detector(), make_renderer(), options);
}

void Player::say(const std::string& message) {
  said_ = message, said_at_ = clock_.seconds();
  std::cout << message << std::endl;
}
std::string Player::notice() const {
  const std::string trouble = source_->trouble();
  if (!trouble.empty()) return trouble;
  return clock_.seconds() - said_at_ < kNew ? said_ : "";
}

void Player::told_or_thrown(const std::exception& error) {
  if (!live_) throw;
  std::cerr << "fastibl-demo: " << error.what() << '\n';
  said_ = error.what(), said_at_ = clock_.seconds();
}

}  // namespace fastibl::demo
