#include "fastibl/capture/light_changes.h"

#include <cstddef>

namespace fastibl {
namespace {

constexpr std::size_t kChanges = 16;  // that are remembered

}  // namespace

void LightChanges::add(double time, const glm::dvec3& log_ratio) {
  if (changes_.size() == kChanges) changes_.erase(changes_.begin());
  changes_.push_back({time, log_ratio});
}

glm::vec3 LightChanges::since(double time) const {
  glm::dvec3 sum(0);
  for (const Change& change : changes_)
    if (change.time >= time) sum += change.log_ratio;
  return glm::exp(sum);
}

}  // namespace fastibl
