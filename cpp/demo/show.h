// Shows the frames in a window, with keys to compare methods.
#pragma once

#include "demo/args.h"

namespace fastibl::demo {

// Runs until the window is closed; with args.frames or args.screenshot it also ends at the last
// frame.
void show(const Args& args);

}  // namespace fastibl::demo
