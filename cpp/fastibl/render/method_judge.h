// When the methods of a session are measured under the light that there is, and chosen anew.
#pragma once

#include <memory>
#include <optional>

#include "fastibl/plan/candidates.h"
#include "fastibl/render/light_summary.h"
#include "fastibl/render/measure_errors.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

class MethodJudge {
 public:
  // By the last judgement that came to its end since forget().
  const MeasuredErrors& measured() const { return measured_; }
  bool due() const { return due_; }
  void forget();                           // what was measured: of another scene
  void judge_anew() { due_ = true; }       // while what was measured still stands
  void choose_anew() { choose_ = true; }   // by what was measured
  void follow(const LightSummary& light);  // judges anew where it is another light than was judged
  // After each frame; with the map of captured light, which is followed, but not in every frame.
  void add_frame(const CubeMap* captured);

  // A judgement of the scene under this light, which is due no longer.
  void begin(const Scene& scene, const std::shared_ptr<const Environment>& environment,
             const Methods& asked, const Candidates& candidates, bool cast_shadow);
  // Goes on with it by a step, or to its end where that is to be or nothing is measured yet. True
  // where methods are to be chosen now.
  bool step(bool to_its_end);

 private:
  MeasuredErrors measured_;
  std::optional<ErrorMeasurement> measurement_;  // that goes on
  std::optional<LightSummary> light_;            // of the last that began
  int frames_ = 0;                               // since then
  bool due_ = true, choose_ = false;
};

}  // namespace fastibl
