#include <algorithm>

#include "demo/overlays/format.h"
#include "demo/overlays/overlay.h"

namespace fastibl::demo {

void draw_timings(Canvas& canvas, const View& view) {
  std::vector<Line> lines = {{fixed(view.timings.frames_per_second(), 1) + " frames/s, " +
                                  fixed(view.timings.recent("total"), 1) + " ms of session",
                              kYellow}};
  for (const std::string& pass : view.timings.order()) {
    if (pass == "total") continue;
    const double milliseconds = view.timings.recent(pass);
    const int bar = std::clamp(int(milliseconds + 0.5), 0, 16);
    lines.push_back(
        {pass + "\t" + fixed(milliseconds, 2) + "\t" + std::string(std::size_t(bar), '|')});
  }
  canvas.panel(Corner::top_right, lines);
}

}  // namespace fastibl::demo
