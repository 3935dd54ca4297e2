// Measures how wrong a picture is with each method that could make it, under the present light.
#pragma once

#include <memory>

#include "fastibl/plan/candidates.h"
#include "fastibl/render/scene_samples.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/near_light.h"

namespace fastibl {

// near_lights: those of the map whose place is known; walls are taken as far away.
struct LightToJudge {
  std::shared_ptr<const CubeMap> map;
  NearLights near_lights;

  // Of an environment that stays alive with the map.
  static LightToJudge of(const std::shared_ptr<const Environment>& environment);
};

// Runs every candidate on the map and compares it, at the samples of the scene, with sums over the
// map along the samples' rays. The parts of a colour are linear in light, so that every combination
// is a sum of parts. There is no brute force for the bounce: where there is a bounce, its error is
// taken as 6 % of its size (docs/shadow.md), and as what it misses of a plane that is not even.
// What is brighter than white is cut, as in a picture of which the object takes 15 %, and whose
// exposure puts the plane at 0.35 of white, or the object's middle pixel at 0.7, whichever is
// darker.
// The same scene, samples and light give the same bits. at: samples of the scene, from all round or
// from one place. The result is empty where there are none, or no light. Takes 20 to 240 ms.
MeasuredErrors measure_errors(const Scene& scene, const SceneSamples* at, const LightToJudge& light,
                              const Methods& asked, const Candidates& candidates, bool cast_shadow);

// The same in steps of some ms, for frames, none of which has time for all of it. at: has to live,
// unchanged, until the measurement is done.
class ErrorMeasurement {
 public:
  ErrorMeasurement(const Scene& scene, const SceneSamples* at, const LightToJudge& light,
                   const Methods& asked, const Candidates& candidates, bool cast_shadow);
  ErrorMeasurement(ErrorMeasurement&&) noexcept;
  ErrorMeasurement& operator=(ErrorMeasurement&&) noexcept;
  ~ErrorMeasurement();

  bool done() const;
  void step();
  MeasuredErrors errors() const;  // once it is done

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

}  // namespace fastibl
