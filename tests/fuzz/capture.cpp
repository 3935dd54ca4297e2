// The pictures, cameras, poses, exposures and options that a capture is given.
#include "capture_run.h"

namespace fastibl {

void fuzz(Input& in) {
  Capture capture(capture_options(in));
  run_capture(in, capture);
}

}  // namespace fastibl
