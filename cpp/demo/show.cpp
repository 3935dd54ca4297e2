#include "demo/show.h"

#include <algorithm>
#include <iostream>

#include "demo/commands.h"
#include "demo/output.h"
#include "demo/overlays/format.h"
#include "demo/script.h"
#include "demo/window.h"
#include "fastibl/core/check.h"
#ifdef FASTIBL_WITH_INTERFACE
#include "demo/interface.h"
#endif

namespace fastibl::demo {
namespace {

constexpr double kIdle = 0.05;  // seconds between checks of a window whose frames stand still

#ifndef FASTIBL_WITH_INTERFACE
// Stands in if the interface's library was not built in: keys and overlays do everything.
struct Interface {
  static constexpr int kWidth = 0, kHeight = 0;
  Interface(GLFWwindow*, bool) {}
  bool usable() const { return false; }
  void build(Player&) {}
  void render() {}
  bool takes_keys() const { return false; }
};
#endif

class Viewer {
 public:
  explicit Viewer(const Args& args)
      : args_(args),
        window_(args.size[0], args.size[1], "fastibl"),  // first: it tells at once what is missing
        player_(args, true),
        script_(args) {
    window_.with_context(
        [&] { interface_ = std::make_unique<Interface>(window_.handle(), window_.desktop_gl()); });
    player_.show_interface = args.interface;
    const Camera& camera = player_.source().rig().back;
    window_.set_size(camera.width + left(),
                     std::max(camera.height, left() > 0 ? Interface::kHeight : 0));
    window_.wait(0);
  }
  ~Viewer() {
    window_.with_context([&] { interface_.reset(); });
  }

  void run() {
    for (const std::string& line : help_lines()) std::cout << line << '\n';
    std::cout << std::flush;
    while (!window_.closed() && !player_.quit) {
      const bool ended = player_.ended() || (args_.frames > 0 && player_.count() >= args_.frames);
      // With args.frames, or a screenshot of the last frame, the program ends by itself.
      if (ended && (args_.frames > 0 || (!args_.screenshot.empty() && args_.at == 0))) break;
      const bool goes_on = !ended && (!player_.frozen || player_.step);
      player_.step = false;
      const bool taken = goes_on && advance();
      if (!taken) player_.refresh();
      show(taken);
      save_screenshot();
      window_.wait(goes_on ? waiting_time() : kIdle);
      for (const std::string& key : window_.keys()) press_key(key);
    }
    check(player_.count() > 0 || !player_.ended(), "no frame could be read");
    script_.at_the_end(player_);
    script_.all_came(player_);
    show(false);
    save_screenshot();
    player_.set_recording(false);
    player_.timings().print(std::cout);
    // Otherwise the exit would wait for an object that is still being made.
    if (player_.is_making()) std::cout << std::flush, std::_Exit(0);
  }

 private:
  int left() const {
    return interface_ && interface_->usable() && player_.show_interface ? Interface::kWidth : 0;
  }

  bool advance() {
    script_.before_frame(player_);
    if (!player_.advance()) return false;
    script_.after_frame(player_);
    return true;
  }

  void press_key(const std::string& key) {
    if (interface_->takes_keys() && key != "tab") return;  // tab hides the panel and its text field
    try {
      press(player_, key);
    } catch (const std::exception& error) {
      player_.say(error.what());
    }
    if (key == "space" || key == "n") resumed_ = true;
  }

  void show(bool new_frame) {
    if (!player_.picture().empty()) draw_picture();
    const Stopwatch watch;
    if (left() > 0) interface_->build(player_);
    window_.show(left(), [&] { draw_interface(); });
    if (!new_frame) return;
    player_.timings().add("window", watch.seconds());
    player_.timings().count_frame();
    set_title();
  }
  void draw_interface() {
    if (left() > 0) interface_->render();
  }

  // Draws the picture with what is for people alone: help and messages.
  void draw_picture() {
    Image<std::uint8_t> picture = player_.picture();
    Canvas canvas(picture);
    const std::string notice = player_.notice();
    if (!notice.empty()) canvas.panel(Corner::top_left, {{notice, kOrange}});
    if (player_.show_help) {
      std::vector<Line> lines;
      for (const std::string& line : help_cells()) lines.push_back({line});
      canvas.sheet(lines);
    }
    window_.set_picture(picture.data.data(), picture.width, picture.height);
  }

  void set_title() {
    window_.set_title("fastibl: " + player_.object() + ", " + player_.material() + ", " +
                      (player_.paper() ? "paper" : "auto") + ", " + player_.backend() +
                      (player_.result().back_from_marker ? "" : ", no board") + ", " +
                      fixed(player_.timings().recent("total"), 1) + " ms   (h: help)");
  }

  // A recording and the simulator are played no faster than they were taken.
  double waiting_time() {
    if (player_.source().live() || !args_.pace) return 0;
    if (player_.count() <= 1 || resumed_)
      start_ = player_.time() - clock_.seconds(), resumed_ = false;
    const double due = player_.time() + 1 / player_.source().fps() - start_;
    if (clock_.seconds() > due + 0.2) resumed_ = true;  // too late to catch up
    return std::clamp(due - clock_.seconds(), 0.0, 0.5);
  }

  void save_screenshot() {
    if (player_.screenshot.empty()) return;
    const std::filesystem::path path = std::exchange(player_.screenshot, {});
    const Window::Pixels pixels = window_.pixels(left(), [&] { draw_interface(); });
    if (pixels.rgb.empty()) return;
    Image<std::uint8_t> picture(pixels.width, pixels.height, 3);
    picture.data = pixels.rgb;
    try {
      write_png(path, picture);
      player_.say("wrote " + path.string());
    } catch (const std::exception& error) {
      player_.say(error.what());
    }
  }

  const Args& args_;
  Window window_;
  Player player_;
  Script script_;
  std::unique_ptr<Interface> interface_;
  bool resumed_ = true;
  Stopwatch clock_;
  double start_ = 0;  // the frames' time when the clock was at 0
};

}  // namespace

void show(const Args& args) { Viewer(args).run(); }

}  // namespace fastibl::demo
