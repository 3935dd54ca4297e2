// Runs a Session over the frames of a source, and holds all that is changed while it runs.
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
  // live: whether a person is watching. If so, objects are made in the background, and after an
  // error the program goes on and shows it on stderr and in the picture. Otherwise errors are
  // thrown.
  Player(const Args& args, bool live);

  // Takes the next frame; returns false if there is none, for now or for good.
  bool advance();
  void refresh();  // draws the same frame again if something was changed
  // The last picture with its overlays; empty before the first one.
  const Image<std::uint8_t>& picture();
  bool picture_is_new() const { return !drawn_; }  // since picture() was last called

  void set_object(const std::string& name);  // one of objects(), or an OBJ file
  void set_material(const std::string& name);
  void set_height(double metres);
  void turn(double degrees);  // on the spot, anticlockwise as seen from above
  void set_cast_shadow(bool cast);
  void set_shadow_strength(double strength);
  void set_methods(const Methods& methods);
  void set_backend(const std::string& name);
  void set_budgets(double error, double milliseconds);
  void set_overlay(std::size_t index, bool on);
  void set_lamp(bool on) { source_->set_lamp(on); }
  void set_recording(bool on, const std::filesystem::path& path = {});
  void restart();  // forgets the map; files and the simulator begin again
  // Shows a message in the picture and prints it on the standard output.
  void say(const std::string& message);

  bool frozen = false, step = false, quit = false, show_help = false, show_interface = true;
  std::filesystem::path screenshot;  // where to store what is shown now; empty: nowhere

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
  bool has(SelfShadowMethod method) const { return session_->has(method); }
  bool lamp() const { return source_->lamp(); }
  bool paper() const { return methods() == Methods::paper(); }
  bool is_making() const {  // whether an object is being made in the background
    return live_ && coming_.valid() &&
           coming_.wait_for(std::chrono::seconds(0)) != std::future_status::ready;
  }
  bool recording() const { return recorder_ != nullptr; }
  std::string notice() const;             // the last message, while it is new
  int unseen() const { return unseen_; }  // number of frames without the board

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
  std::string coming_name_;    // the object that was asked for last
  double coming_height_ = 0;
  bool again_ = false;  // another object was asked for than is being made
  std::unique_ptr<Recorder> recorder_;
  std::shared_ptr<const OwnedFrame> frame_, shown_;  // the last one, and the last with a back picture
  FrameResult result_;
  std::optional<Tracked> tracked_;  // kept for the frame, however often it is drawn
  Image<std::uint8_t> picture_;
  bool changed_ = false, drawn_ = false;
  int count_ = 0, unseen_ = 0, slow_ = 0;  // frames
  bool hurried_ = false;                   // a time budget was set because it was slow
  Timings timings_;
  std::string said_;
  Stopwatch clock_;
  double said_at_ = -1e9;
};

}  // namespace fastibl::demo
