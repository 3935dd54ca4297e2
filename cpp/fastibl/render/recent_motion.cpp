#include "fastibl/render/recent_motion.h"

namespace fastibl {
namespace {

constexpr double kLongestGap = 0.25;  // seconds; a hand that was unseen for longer may be anywhere

}  // namespace

void RecentMotion::add(double time, const Pose& camera_from_marker) {
  if (!moments_.empty() && time == moments_.back().time) moments_.pop_back();
  if (!moments_.empty() &&
      !(time > moments_.back().time && time - moments_.back().time <= kLongestGap))
    moments_.clear();
  if (moments_.size() == 3) moments_.erase(moments_.begin());
  moments_.push_back({time, camera_from_marker});
}

std::optional<MotionRate> RecentMotion::motion() const {
  const std::size_t n = moments_.size();
  if (n < 2) return std::nullopt;
  const Moment &now = moments_[n - 1], &before = moments_[n - 2];
  const double step = now.time - before.time;
  MotionRate rate{motion_between(before.pose, now.pose).seen_from(1), step};
  if (n < 3) return rate;
  const Moment& first = moments_[n - 3];
  const double longer = before.time - first.time, by = 2 * step / (step + longer);
  const RowMotion old = motion_between(first.pose, before.pose).seen_from(1);
  const glm::dmat3 turned = now.pose.rotation * glm::transpose(before.pose.rotation);
  RowMotion& m = rate.motion;
  m.turning = by * (m.turn - step / longer * old.turn);
  m.shifting = by * (m.shift - step / longer * (turned * old.shift));
  m.turn += 0.5 * m.turning, m.shift += 0.5 * m.shifting;
  return rate;
}

}  // namespace fastibl
