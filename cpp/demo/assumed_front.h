// Front cameras that tell no exposure: one is assumed, and then measured by the board's white.
#pragma once

#include <optional>

#include "fastibl/render/session.h"

namespace fastibl::demo {

// As fastibl.untold_exposure has it.
class AssumedFront {
 public:
  // Without one, such pictures would be compared with a map that knows nothing of what they show,
  // and left out.
  void fill(Frame& frame);
  // The exposure, where a captured map tells another one than was assumed: it is used from now on,
  // and the map is in the wrong scale.
  std::optional<double> measure(const Environment* environment);

 private:
  double exposure_ = 1;
  bool untold_ = false;
  int frames_ = 0, rounds_ = 0;
};

}  // namespace fastibl::demo
