#include "demo/show.h"

#include <algorithm>
#include <iostream>
#include <sstream>

#include "demo/output.h"
#include "demo/overlay.h"
#include "demo/run.h"
#include "demo/window.h"
#include "fastibl/core/clock.h"

namespace fastibl::demo {
namespace {

constexpr const char* kHelp = R"(keys:
  m       methods: the library's choice, or the paper's of 2014
  d       next diffuse method
  b       back end: cpu, gl
  e       show the captured map; what no camera saw is striped
  s       shadow on or off
  space   pause; n: one frame further
  p       save the window as a PNG
  h, F1   this help
  q, Esc  quit
)";

class Viewer {
 public:
  explicit Viewer(const Args& args)
      : args_(args),
        source_(open_source(args)),
        window_(source_->rig().back.width, source_->rig().back.height, "fastibl"),
        session_(make_session(args, *source_)),
        methods_(methods_preset(args.paper)),
        paper_(args.paper),
        cast_shadow_(args.cast_shadow) {}

  void run() {
    std::cout << kHelp << std::flush;
    while (!window_.closed() && !quit_) {
      const bool ended = ended_ || (args_.frames > 0 && count_ >= args_.frames);
      if (ended && (args_.frames > 0 || !args_.screenshot.empty())) break;
      if (!ended && (!paused_ || step_)) advance();
      step_ = false;
      window_.wait(paused_ || ended ? 0.1 : waiting_time());
      for (const char key : window_.keys()) press(key);
    }
    check(count_ > 0 || !ended_, "no frame could be read");
    if (!args_.screenshot.empty()) save(args_.screenshot);
    timings_.print(std::cout);
  }

 private:
  void advance() {
    std::optional<OwnedFrame> next = source_->next();
    ended_ = !next;
    if (ended_) return;
    frame_ = std::move(*next);
    ++count_;
    result_ = session_.process(frame_.view());
    timings_.add(result_.timings);
    draw();
  }

  // The same frame once more, by other methods. The map stays as it is: a picture counts once.
  void redraw() {
    if (count_ == 0 || frame_.back.empty()) return;
    if (result_.back_from_marker && result_.environment) {
      Frame frame = frame_.view();
      frame.front = {}, frame.back_from_marker = result_.back_from_marker;
      frame.back_last_row = result_.back_last_row;
      session_.set_environment(result_.environment);
      result_ = session_.process(frame);
      session_.set_environment(nullptr);
    }
    draw();
  }

  void draw() {
    if (frame_.back.empty()) return;  // a front picture alone feeds the map
    Image<std::uint8_t> picture = result_.image;
    if (show_map_ && result_.environment)
      draw_map(picture, *result_.environment, frame_.back_exposure.value_or(1));
    window_.show(picture.data.data(), picture.width, picture.height);
    std::ostringstream title;
    title.precision(1);
    title << std::fixed << "fastibl: " << (paper_ ? "paper" : "auto") << ", "
          << name(methods_.diffuse) << ", " << session_.renderer().backend()
          << (cast_shadow_ ? "" : ", no shadow") << (result_.back_from_marker ? "" : ", no board")
          << ", " << timings_.recent_milliseconds() << " ms   (h: help)";
    window_.set_title(title.str());
  }

  // A recording plays no faster than it was taken.
  double waiting_time() {
    if (source_->live()) return 0;
    if (count_ <= 1 || resumed_) start_ = frame_.time - clock_.seconds(), resumed_ = false;
    return std::clamp(frame_.time + 1 / source_->fps() - start_ - clock_.seconds(), 0.0, 0.5);
  }

  void press(char key) {
    switch (key) {
      case 'm':
        paper_ = !paper_, methods_ = methods_preset(paper_);
        return session_.set_methods(methods_), redraw();
      case 'd':
        // `automatic` is the first value of the enum and not in the list.
        methods_.diffuse = kDiffuseMethods[std::size_t(methods_.diffuse) % kDiffuseMethods.size()];
        return session_.set_methods(methods_), redraw();
      case 'b':
        return next_backend();
      case 'e':
        show_map_ = !show_map_;
        return draw();
      case 's':
        cast_shadow_ = !cast_shadow_;
        return session_.set_cast_shadow(cast_shadow_), redraw();
      case ' ':
        paused_ = !paused_, resumed_ = true;
        return;
      case 'n':
        paused_ = step_ = true;
        return;
      case 'p':
        return save("fastibl-" + std::to_string(count_) + ".png");
      case 'h':
        std::cout << kHelp << std::flush;
        return;
      case 'q':
        quit_ = true;
    }
  }

  void next_backend() {
    const std::string other = session_.renderer().backend() == "cpu" ? "gl" : "cpu";
    try {
      session_.set_renderer(make_renderer(other));
      redraw();
    } catch (const std::exception& error) {
      std::cerr << "fastibl-demo: " << error.what() << '\n';
    }
  }

  void save(const std::filesystem::path& path) {
    const Window::Pixels pixels = window_.pixels();
    if (pixels.rgb.empty()) return;
    Image<std::uint8_t> picture(pixels.width, pixels.height, 3);
    picture.data = pixels.rgb;
    write_png(path, picture);
    std::cout << "wrote " << path.string() << std::endl;
  }

  const Args& args_;
  std::unique_ptr<FrameSource> source_;
  Window window_;
  Session session_;
  Methods methods_;
  bool paper_, cast_shadow_, show_map_ = false;
  bool paused_ = false, step_ = false, quit_ = false, ended_ = false, resumed_ = true;
  int count_ = 0;
  OwnedFrame frame_;
  FrameResult result_;
  Timings timings_;
  Stopwatch clock_;
  double start_ = 0;  // time of the frames when the clock was at 0
};

}  // namespace

void show(const Args& args) { Viewer(args).run(); }

}  // namespace fastibl::demo
