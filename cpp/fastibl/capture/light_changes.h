// The changes of all the light of a place.
#pragma once

#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

class LightChanges {
 public:
  // log_ratio: ln of the factor by channel. time: seconds, not decreasing.
  void add(double time, const glm::dvec3& log_ratio);
  // Factor by which the place is thought to have changed since then.
  glm::vec3 since(double time) const;

 private:
  struct Change {
    double time;
    glm::dvec3 log_ratio;
  };
  std::vector<Change> changes_;  // as they were found: the latest last
};

}  // namespace fastibl
