// A Session over the frames of a source, and all that is changed while it runs.
#pragma once

#include <array>
#include <chrono>
#include <filesystem>
#include <future>
#include <memory>
#include <string>

#include "demo/args.h"
#include "demo/frame_source.h"
#include "demo/materials.h"
#include "demo/object_list.h"
#include "demo/overlays/overlay.h"
#include "demo/recorder.h"
#include "demo/timings.h"

namespace fastibl::demo {

class Player {
 public:
  // live: a person looks on. Objects are then made beside the frames, what is wrong is told and
  // gone on from, and told in the picture, too; otherwise it throws.
  Player(const Args& args, bool live);

  // Takes the next frame; false where there is none, now or any more.
  bool advance();
  void refresh();  // the same frame once more, where something was changed
  // The last picture with its overlays; empty before the first.
  const Image<std::uint8_t>& picture();
  bool picture_is_new() const { return !drawn_; }  // since picture() was last called

  void set_object(const std::string& name);  // of objects(), or an OBJ file
  void set_material(const std::string& name);
  void set_height(double metres);
  void turn(double degrees);  // on the spot, anticlockwise from above
  void set_cast_shadow(bool cast);
  void set_shadow_strength(double strength);
  void set_methods(const Methods& methods);
  void set_backend(const std::string& name);
  void set_budgets(double error, double milliseconds);
  void set_overlay(std::size_t index, bool on);
  void set_lamp(bool on) { source_->set_lamp(on); }
  void set_recording(bool on, const std::filesystem::path& path = {});
  void restart();  // forgets the map; files and the simulator begin again
  // For people, and on the standard output.
  void say(const std::string& message);

  bool frozen = false, step = false, quit = false, show_help = false, show_interface = true;
  std::filesystem::path screenshot;  // that is wanted of what is shown now; empty: none

  const Args& args() const { return args_; }
  FrameSource& source() { return *source_; }
  Session& session() { return *session_; }
  const FrameResult& result() const { return result_; }
  Timings& timings() { return timings_; }
  int count() const { return count_; }  // frames taken
  bool ended() const { return source_->ended(); }
  double time() const { return frame_ ? frame_->time : 0; }  // seconds, of the last frame
  bool overlay(std::size_t index) const { return overlays_[index]; }
  const std::vector<std::string>& objects() const { return objects_.names(); }
  const std::string& object() const { return object_; }
  const std::string& material() const { return material_; }
  double height() const { return height_; }
  const SessionOptions& options() const { return session_->options(); }
  const Methods& methods() const { return options().methods; }
  const ShadowLook& shadow_look() const { return session_->scene().shadow_look; }
  const std::string& backend() const { return backend_; }
  bool lamp() const { return source_->lamp(); }
  bool paper() const { return methods() == Methods::paper(); }
  bool is_making() const {  // an object, beside the frames
    return live_ && coming_.valid() &&
           coming_.wait_for(std::chrono::seconds(0)) != std::future_status::ready;
  }
  bool recording() const { return recorder_ != nullptr; }
  std::string notice() const;             // what was said last, while it is new
  int unseen() const { return unseen_; }  // frames without the board

 private:
  Scene make_object(Mesh mesh, double height) const;
  void wish_for_object(const std::string& name, double height);
  void begin_object();
  void adopt_object();
  void show_object(Scene scene);
  void begin_recording(const std::filesystem::path& folder);
  std::unique_ptr<Renderer> make_renderer();
  void make_session(Scene scene);
  void begin_session();
  void record_frame();
  void watch_time(const FrameResult& result);
  void told_or_thrown(const std::exception& error);

  Args args_;
  bool live_;
  std::unique_ptr<FrameSource> source_;
  ObjectList objects_;
  std::string object_, material_ = "given", backend_;
  double height_, turned_ = 0;  // metres, degrees
  std::array<bool, kOverlays.size()> overlays_{};
  std::optional<Board> board_;
  std::unique_ptr<Session> session_;
  std::future<Scene> coming_;  // the next object
  std::string coming_name_;    // of the last wish
  double coming_height_ = 0;
  bool again_ = false;  // the wish is another than what is being made
  std::unique_ptr<Recorder> recorder_;
  std::shared_ptr<const OwnedFrame> frame_;
  FrameResult result_;
  std::optional<Tracked> tracked_;  // of the frame, however often it is drawn
  Image<std::uint8_t> picture_;
  bool changed_ = false, drawn_ = false;
  int count_ = 0, unseen_ = 0, slow_ = 0;  // frames
  bool hurried_ = false;                   // a time was asked for because it was slow
  Timings timings_;
  std::string said_;
  Stopwatch clock_;
  double said_at_ = -1e9;
};

}  // namespace fastibl::demo
