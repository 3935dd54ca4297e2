// Decides when a session's methods are measured under the present light, and chosen anew.
#pragma once

#include <optional>

#include "fastibl/plan/candidates.h"
#include "fastibl/render/light_summary.h"
#include "fastibl/render/measure_errors.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

class MethodJudge {
 public:
  // What the last judgement measured that was completed since forget().
  const MeasuredErrors& measured() const { return measured_; }
  // Share of the light by which this light differs from the one in which that was measured; 0 where
  // it differs so little that it says much about both.
  double unjudged(const LightSummary& light) const;
  bool due() const { return due_; }
  void forget();                          // drops what was measured, for another scene
  void judge_anew() { due_ = true; }      // what was measured stands until then
  void choose_anew() { choose_ = true; }  // from what was measured
  // Judges anew for another light than that judged last, but not soon after that: follow() does
  // nothing while the light is not looked at.
  bool looks() const { return !due_ && !measurement_ && frames_ >= wait_; }
  void follow(const LightSummary& light);
  // In light that stays: judges at once where the object was moved so close to a lamp, or away from
  // it, that a quarter of the light on it is another.
  void follow_move(const LightSummary& light);
  void add_frame() { ++frames_; }

  // Begins a judgement of the scene under this light; it is then no longer due.
  void begin(const Scene& scene, const LightToJudge& light, const LightSummary& summary,
             const Methods& asked, const Candidates& candidates, bool cast_shadow);
  // Goes on with the judgement by one step; or to its end, if asked to or if nothing is measured
  // yet. True where methods are to be chosen now.
  bool step(bool to_its_end);

 private:
  MeasuredErrors measured_;
  std::optional<ErrorMeasurement> measurement_;  // in progress, if any
  LightSummary light_;                           // of the judgement that began last
  LightSummary measured_light_;                  // of measured_
  int frames_ = 0;                               // since it began
  int wait_ = 0;  // frames before light that changes makes another due
  bool due_ = true, at_once_ = false, choose_ = false;
};

}  // namespace fastibl
