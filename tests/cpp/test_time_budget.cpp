// How a time budget is kept: numbers of frames that no film would show in time.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <array>

#include "fastibl/render/light_turns.h"
#include "fastibl/render/time_budget.h"

using namespace fastibl;

namespace {

constexpr double kBudget = 10, kPlanned = 8, kSlow = 12, kQuick = 5;

// Adds frames that take this long; the number of changes of the slowdown.
int add(TimeBudget& time, int frames, double milliseconds, double planned = kPlanned) {
  int changes = 0;
  for (int k = 0; k < frames; ++k) changes += time.add(milliseconds, planned, kBudget);
  return changes;
}

}  // namespace

TEST_CASE("a tenth of the frames may be late, and more are not waited for") {
  TimeBudget time;
  CHECK(add(time, 3, kSlow) + add(time, TimeBudget::kFrames - 3, 9) == 0);
  CHECK(time.slowdown() == 1);
  CHECK(add(time, 3, kSlow) == 0);
  CHECK(add(time, 1, kSlow) == 1);
  CHECK(time.slowdown() == 1.25);
  CHECK(add(time, 3, kSlow) == 0);  // what was late under the last plan is forgotten
  CHECK(add(time, 1, kSlow) == 1);
}

TEST_CASE("steps are taken back, but not soon to where frames were late") {
  TimeBudget time;
  add(time, 4, kSlow);
  CHECK(add(time, 10 * TimeBudget::kFrames, kQuick) == 2);
  CHECK(time.slowdown() == doctest::Approx(1.25 * 0.9 * 0.9));
  CHECK(add(time, TimeBudget::kForget, kQuick) > 2);
  CHECK(time.slowdown() < 0.8);
  CHECK(add(time, 100 * TimeBudget::kFrames, kQuick) > 0);
  CHECK(time.slowdown() == 0.3);  // at least: a cost table is not that wrong
  CHECK(add(time, 10 * TimeBudget::kFrames, 0.8 * kBudget) == 0);  // in time, and not far quicker
}

TEST_CASE("frames that shade nothing are quick whatever the plan") {
  TimeBudget time;
  for (int k = 0; k < 20 * TimeBudget::kFrames; ++k)
    CHECK_FALSE(time.add(kQuick, kPlanned, kBudget, false));
  CHECK(time.slowdown() == 1);
  for (int k = 0; k < 4; ++k) time.add(kSlow, kPlanned, kBudget, false);
  CHECK(time.slowdown() == 1.25);  // late is late
}

TEST_CASE("where no plan is cheaper the light is spread, and stays so for a while") {
  TimeBudget time;
  CHECK(add(time, 4, kSlow, 2 * kBudget) == 0);
  CHECK(time.slowdown() == 1);
  CHECK(time.spreads());
  add(time, TimeBudget::kForget - TimeBudget::kFrames, kQuick);
  CHECK(time.spreads());
  add(time, 2 * TimeBudget::kFrames, kQuick);
  CHECK_FALSE(time.spreads());
}

TEST_CASE("one by one, the step that has waited longest is taken") {
  LightTurns turns;
  std::array<int, kLightSteps> taken{};
  for (int frame = 0; frame < 9; ++frame) {
    turns.next({true, true, true, false}, true);
    int now = 0;
    for (int k = 0; k < kLightSteps; ++k)
      if (turns.takes(LightStep(k))) ++taken[std::size_t(k)], ++now;
    CHECK(now == 1);
  }
  CHECK(taken == std::array<int, kLightSteps>{3, 3, 3, 0});
  turns.next({true, true, true, true}, true);
  CHECK(turns.takes(LightStep::look));  // it never came yet
  turns.next({true, false, true, true}, false);
  CHECK(turns.takes(LightStep::front));
  CHECK_FALSE(turns.takes(LightStep::back));
  turns.next({}, true);
  CHECK_FALSE(turns.takes(LightStep::front));
}
