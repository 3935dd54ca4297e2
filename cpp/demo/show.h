// The frames in a window, with keys to compare methods.
#pragma once

#include "demo/args.h"

namespace fastibl::demo {

// Until the window is closed; with args.frames or args.screenshot also at the last frame.
void show(const Args& args);

}  // namespace fastibl::demo
