// Processes frames without a window.
#pragma once

#include "demo/args.h"

namespace fastibl::demo {

// Processes all frames with the commands of args.cues; writes pictures to args.out and
// args.screenshot, and prints the timings. Returns false if the frames ended before a command or a
// screenshot was due.
bool run_headless(const Args& args);

}  // namespace fastibl::demo
