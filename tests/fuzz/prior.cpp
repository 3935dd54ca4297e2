// A prior map of any size and content, under pictures of any content.
#include "capture_run.h"

namespace fastibl {

void fuzz(Input& in) {
  CaptureOptions options = capture_options(in);
  options.prior = std::make_shared<const CubeMap>(any_map(in, 40));
  Capture capture(options);
  check_environment(*capture.environment());
  run_capture(in, capture);
}

}  // namespace fastibl
