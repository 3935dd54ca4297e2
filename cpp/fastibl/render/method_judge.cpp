#include "fastibl/render/method_judge.h"

#include <utility>

#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr int kLeastFrames = 60;  // between judgements: each takes as long as some frames

}  // namespace

void MethodJudge::forget() { measured_ = {}, measurement_.reset(), due_ = true; }

void MethodJudge::follow(const LightSummary& light) {
  if (!measurement_ && (!light_ || is_other_light(light, *light_))) due_ = true;
}

void MethodJudge::add_frame(const CubeMap* captured) {
  ++frames_;
  if (due_ || !captured) return;
  due_ = !light_ || (frames_ >= kLeastFrames && is_other_light(summary_of(*captured), *light_));
}

void MethodJudge::begin(const Scene& scene, const std::shared_ptr<const Environment>& environment,
                        const Methods& asked, const Candidates& candidates, bool cast_shadow) {
  due_ = false, frames_ = 0;
  const std::shared_ptr<const CubeMap> radiance(environment, &environment->radiance);
  measurement_.emplace(scene, scene.samples.get(), radiance, asked, candidates, cast_shadow);
  light_ = summary_of(*radiance);
}

bool MethodJudge::step(bool to_its_end) {
  if (measurement_) {
    const OneThread loops(OneThread::Loops::together);
    const bool at_once = to_its_end || measured_.empty();
    try {
      do measurement_->step();
      while (at_once && !measurement_->done());
    } catch (...) {  // half a judgement is of no use
      measurement_.reset(), due_ = true;
      throw;
    }
    if (measurement_->done())
      measured_ = measurement_->errors(), measurement_.reset(), choose_ = true;
  }
  return std::exchange(choose_, false) && !measured_.empty();
}

}  // namespace fastibl
