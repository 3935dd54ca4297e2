#include "fastibl/render/method_judge.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

// Frames between judgements, each of which takes as long as some frames: few while a place is being
// discovered, and twice as many each time while the light goes on changing.
constexpr int kLeastFrames = 4, kMostFrames = 64;

}  // namespace

void MethodJudge::forget() { measured_ = {}, measurement_.reset(), due_ = true; }

double MethodJudge::unjudged(const LightSummary& light) const {
  if (measured_.empty() || !is_other_light(light, measured_light_)) return 0;
  return std::min(std::max({difference(light, measured_light_),
                            std::abs(light.compact - measured_light_.compact),
                            std::abs(light.nearby - measured_light_.nearby)}),
                  1.0f);
}

void MethodJudge::follow(const LightSummary& light) {
  if (looks()) due_ = is_other_light(light, light_);
}

void MethodJudge::follow_move(const LightSummary& light) {
  constexpr float kElsewhere = 0.25f;
  if (!measured_.empty() && std::abs(light.nearby - measured_light_.nearby) > kElsewhere)
    due_ = at_once_ = true;
}

void MethodJudge::begin(const Scene& scene, const LightToJudge& light, const LightSummary& summary,
                        const Methods& asked, const Candidates& candidates, bool cast_shadow) {
  wait_ =
      frames_ < 2 * kMostFrames ? std::clamp(2 * wait_, kLeastFrames, kMostFrames) : kLeastFrames;
  due_ = false, frames_ = 0;
  measurement_.emplace(scene, scene.samples.get(), light, asked, candidates, cast_shadow);
  light_ = summary;
}

bool MethodJudge::step(bool to_its_end) {
  if (measurement_) {
    const OneThread loops(OneThread::Loops::together);
    const bool at_once = to_its_end || at_once_ || measured_.empty();
    try {
      do measurement_->step();
      while (at_once && !measurement_->done());
    } catch (...) {  // half a judgement is of no use
      measurement_.reset(), due_ = true;
      throw;
    }
    if (measurement_->done())
      measured_ = measurement_->errors(), measured_light_ = light_, measurement_.reset(),
      choose_ = true, at_once_ = false;
  }
  return std::exchange(choose_, false) && !measured_.empty();
}

}  // namespace fastibl
