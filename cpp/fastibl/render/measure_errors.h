// How wrong a picture is with each method that could make it, under the light that there is.
#pragma once

#include <memory>

#include "fastibl/plan/candidates.h"
#include "fastibl/render/scene_samples.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

// Every candidate is run on the map and compared, at the samples of the scene, with sums over the
// map by the samples' rays; the parts of a colour are linear in light, so that every combination
// is a sum of parts. Of the bounce no brute force is at hand: it is taken for 6 % of its size
// wrong where it is there (docs/shadow.md). What is brighter than white is cut, as in a picture
// that is exposed so that the plane has 0.35 of white, and of which the object takes 15 %.
// The same scene, samples and map give the same bits. at: samples of the scene, from all round or
// from one place. Empty where there are none, or the map has no light. 20 to 130 ms.
MeasuredErrors measure_errors(const Scene& scene, const SceneSamples* at,
                              const std::shared_ptr<const CubeMap>& map, const Methods& asked,
                              const Candidates& candidates, bool cast_shadow);

// The same in steps of some ms (one of each candidate's, mostly): for frames, of which none has
// time for all of it. at: has to live until it is done, as it is.
class ErrorMeasurement {
 public:
  ErrorMeasurement(const Scene& scene, const SceneSamples* at, std::shared_ptr<const CubeMap> map,
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
