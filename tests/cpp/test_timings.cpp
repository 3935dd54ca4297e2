// The native program's times of its passes.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <sstream>

#include "demo/timings.h"

using fastibl::demo::Timings;

TEST_CASE("of a long run, all frames are counted and the times of the last ones kept") {
  Timings timings;
  const int before = 3 * int(Timings::kKept), after = int(Timings::kKept);
  for (int k = 0; k < before + after; ++k) {
    timings.add({{"track", 0.001}, {"total", k < before ? 0.004 : 0.002}});
    timings.add("source", 0.003);
    timings.count_frame();
  }
  CHECK(timings.recent("total") == doctest::Approx(2));
  CHECK(timings.frames_per_second() > 0);
  std::ostringstream out;
  timings.print(out);
  MESSAGE(out.str());
  CHECK(out.str().find("total         40000       2.00     2.00\n") != std::string::npos);
  CHECK(out.str().find("source        40000       3.00     3.00\n") != std::string::npos);
  CHECK(out.str().find("285.7 frames/s of processing") != std::string::npos);  // 40000 in 140 s
  CHECK(out.str().find("frames/s in all") != std::string::npos);
}

TEST_CASE("a run of one frame has no rate") {
  Timings timings;
  CHECK(timings.recent("total") == 0);
  timings.add({{"total", 0.004}});
  timings.count_frame();
  CHECK(timings.frames_per_second() == 0);
  std::ostringstream out;
  timings.print(out);
  CHECK(out.str().find("frames/s in all") == std::string::npos);
}
