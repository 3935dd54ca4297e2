// From the arguments to a source of frames, the board that it shows, and a back end.
#pragma once

#include <memory>

#include "demo/args.h"
#include "demo/frame_source.h"

namespace fastibl::demo {

std::unique_ptr<FrameSource> open_source(const Args& args);
// The board that poses are tracked on; nothing where they are given and the recording has none.
std::optional<Board> board_for(const Args& args, const FrameSource& source);
// "cpu", or "gl" where it was built in; throws std::invalid_argument otherwise, and
// std::runtime_error where there is no driver.
std::unique_ptr<Renderer> make_renderer(const std::string& backend);

}  // namespace fastibl::demo
