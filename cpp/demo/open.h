// Makes from the arguments: a source of frames, the board that it shows, and a back end.
#pragma once

#include <memory>

#include "demo/args.h"
#include "demo/frame_source.h"

namespace fastibl::demo {

std::unique_ptr<FrameSource> open_source(const Args& args);
// The board on which poses are tracked. Nothing if the poses are given and the recording has no
// board.
std::optional<Board> board_for(const Args& args, const FrameSource& source);
// backend: "cpu", or "gl" if that was built in; throws std::invalid_argument for anything else, and
// std::runtime_error if there is no driver.
std::unique_ptr<Renderer> make_renderer(const std::string& backend);

}  // namespace fastibl::demo
