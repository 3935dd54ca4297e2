// The entry that libFuzzer, or the replay, calls.
#include <cstdio>
#include <cstdlib>
#include <stdexcept>

#include "fastibl/core/parallel.h"
#include "input.h"

namespace fastibl {

void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", what);
  std::abort();
}

}  // namespace fastibl

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const bool once = (fastibl::set_threads(1), true);
  (void)once;
  fastibl::Input input(data, size);
  try {
    fastibl::fuzz(input);
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
