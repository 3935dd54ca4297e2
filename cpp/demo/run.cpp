#include "demo/run.h"

#include <iostream>

#include "demo/calibration.h"
#include "demo/camera_source.h"
#include "demo/object.h"
#include "demo/output.h"
#include "demo/recording_reader.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/tracking/opencv/opencv_detector.h"
#ifdef FASTIBL_WITH_GL
#include "fastibl/render/gl/gl_renderer.h"
#endif

namespace fastibl::demo {
namespace {

// The board that poses are tracked on; nothing where they are given and the recording has none.
std::optional<Board> board_for(const Args& args, const FrameSource& source) {
  if (!args.board.empty()) {
    const std::optional<Board> board = read_board(args.board);
    check(board.has_value(), args.board.string(), " lists no tags");
    return board;
  }
  if (const auto* recording = dynamic_cast<const RecordingReader*>(&source)) {
    if (recording->board() || args.true_poses) return recording->board();
    std::cerr << "fastibl-demo: the recording has no board; looking for the default one\n";
  }
  return Board::default_board();
}

}  // namespace

std::unique_ptr<FrameSource> open_source(const Args& args) {
  if (!args.recording.empty())
    return std::make_unique<RecordingReader>(args.recording, args.true_poses);
  return std::make_unique<CameraSource>(args.back, args.front, read_rig(args.rig));
}

Methods methods_preset(bool paper) { return paper ? Methods::paper() : Methods{}; }

std::unique_ptr<Renderer> make_renderer(const std::string& backend) {
  if (backend == "cpu") return make_cpu_renderer();
#ifdef FASTIBL_WITH_GL
  if (backend == "gl") return make_gl_renderer();
#endif
  throw std::invalid_argument("this fastibl-demo was built without the back end \"" + backend +
                              "\"; build it with FASTIBL_GL=ON, or use --backend cpu");
}

Session make_session(const Args& args, const FrameSource& source) {
  Mesh mesh = args.object.empty() ? knot() : read_obj(args.object, args.z_up);
  SceneOptions scene_options;
  scene_options.bake_shadow = !args.paper;
  Scene scene =
      make_scene(stand(std::move(mesh), args.height), args.material, Pose(), scene_options);
  SessionOptions options;
  options.methods = methods_preset(args.paper);
  scene.shadow_look = args.shadow_look;
  options.cast_shadow = args.cast_shadow;
  return Session(std::move(scene), source.rig(), board_for(args, source), nullptr,
                 opencv_detector(), make_renderer(args.backend), options);
}

void run_headless(const Args& args, FrameSource& source, Session& session) {
  Output output(args.out, source.fps());
  Timings timings;
  int count = 0, unseen = 0;
  while (args.frames == 0 || count < args.frames) {
    const std::optional<OwnedFrame> frame = source.next();
    if (!frame) break;
    const FrameResult result = session.process(frame->view());
    timings.add(result.timings);
    ++count;
    if (frame->back.empty()) continue;  // it fed the map; there is no picture to show
    if (!result.back_from_marker) ++unseen;
    output.add(result.image);
  }
  output.finish();
  check(count > 0, "no frame could be read");
  timings.print(std::cout);
  if (unseen > 0)
    std::cout << "the board was not seen in " << unseen << " of " << count << " frames\n";
}

}  // namespace fastibl::demo
