#include "fastibl/capture/row_poses.h"

#include <glm/gtc/quaternion.hpp>

namespace fastibl {

Pose RowPoses::at(double share) const {
  if (!rolling_ || share == 0) return first_;
  const glm::dmat3 turn = glm::mat3_cast(
      glm::slerp(glm::quat_cast(first_.rotation), glm::quat_cast(last_.rotation), share));
  const glm::dvec3 eye = glm::mix(first_.inverse().translation, last_.inverse().translation, share);
  return {turn, -(turn * eye)};
}

}  // namespace fastibl
