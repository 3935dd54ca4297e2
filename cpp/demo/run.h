// A Session over the frames of a source, as the arguments want it.
#pragma once

#include <memory>

#include "demo/args.h"
#include "demo/frame_source.h"
#include "demo/timings.h"

namespace fastibl::demo {

std::unique_ptr<FrameSource> open_source(const Args& args);
Session make_session(const Args& args, const FrameSource& source);
// "cpu", or "gl" where it was built in; throws std::invalid_argument otherwise.
std::unique_ptr<Renderer> make_renderer(const std::string& backend);
Methods methods_preset(bool paper);

// Processes all frames; leaves pictures at args.out and prints the timings.
void run_headless(const Args& args, FrameSource& source, Session& session);

}  // namespace fastibl::demo
