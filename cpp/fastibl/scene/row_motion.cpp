#include "fastibl/scene/row_motion.h"

namespace fastibl {
namespace {

glm::dvec3 way(const glm::dvec3& speed, const glm::dvec3& acceleration, double share) {
  return share * (speed + 0.5 * share * acceleration);
}

}  // namespace

glm::dvec3 RowMotion::moved(const glm::dvec3& point, double share) const {
  return slightly_turned(way(turn, turning, share), point + way(shift, shifting, share));
}

Pose RowMotion::moved(const Pose& pose, double share) const {
  const glm::dmat3 turned = rotation_from_vector(way(turn, turning, share));
  return {turned * pose.rotation, turned * (pose.translation + way(shift, shifting, share))};
}

glm::dvec3 RowMotion::speed(const glm::dvec3& point, double share) const {
  return glm::cross(turn + share * turning, point) +
         slightly_turned(way(turn, turning, share), shift + share * shifting);
}

// A turn whose axis changes is given to first order.
RowMotion RowMotion::seen_from(double share) const {
  const glm::dmat3 turned = rotation_from_vector(way(turn, turning, share));
  return {turn + share * turning, turned * (shift + share * shifting), turning, turned * shifting};
}

RowMotion motion_between(const Pose& first, const Pose& last) {
  const glm::dmat3 turned = last.rotation * glm::transpose(first.rotation);
  return {rotation_vector(turned), glm::transpose(turned) * last.translation - first.translation};
}

}  // namespace fastibl
