#include "demo/open.h"

#include <iostream>

#include "demo/calibration.h"
#include "demo/camera_source.h"
#include "demo/recording_reader.h"
#include "demo/simulator/simulator_source.h"
#include "fastibl/core/check.h"
#ifdef FASTIBL_WITH_GL
#include "fastibl/render/gl/gl_renderer.h"
#endif

namespace fastibl::demo {

std::unique_ptr<FrameSource> open_source(const Args& args) {
  if (args.simulate)
    return std::make_unique<SimulatorSource>(args.size[0], args.size[1], args.true_poses);
  if (!args.recording.empty())
    return std::make_unique<RecordingReader>(args.recording, args.true_poses);
  return std::make_unique<CameraSource>(args.back, args.front, read_rig(args.rig));
}

std::optional<Board> board_for(const Args& args, const FrameSource& source) {
  if (!args.board.empty()) {
    const std::optional<Board> board = read_board(args.board);
    check(board.has_value(), args.board.string(), " lists no tags");
    return board;
  }
  if (const std::optional<Board> board = source.board(); board || args.true_poses) return board;
  if (!args.recording.empty())
    std::cerr << "fastibl-demo: the recording has no board; looking for the default one\n";
  return Board::default_board();
}

std::unique_ptr<Renderer> make_renderer(const std::string& backend) {
  if (backend == "cpu") return make_cpu_renderer();
#ifdef FASTIBL_WITH_GL
  if (backend == "gl") return make_gl_renderer();
#endif
  throw std::invalid_argument("this fastibl-demo was built without the back end \"" + backend +
                              "\"; build it with FASTIBL_GL=ON, or use --backend cpu");
}

}  // namespace fastibl::demo
