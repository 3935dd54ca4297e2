#include "fastibl/tracking/gyro_model.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kForget = 0.99;          // a frame
constexpr double kLeastNoise = 2e-4;      // radians, of the difference of two turns
constexpr double kOutlier = 4;            // deviations, above which differences count less
constexpr double kTurns = 0.5 * kDegree;  // from one frame to the next
constexpr double kClear = 4;              // times the variance of a turn, above which it tells
constexpr double kLeastTurned = 12;       // frames
constexpr double kMostOtherwise = 0.3;    // of these
constexpr double kRateError = 0.3;        // of the change of a rate: of its value at the last frame

glm::dmat3 turn_between(const glm::dmat3& before, const glm::dmat3& now) {
  return now * glm::transpose(before);
}

}  // namespace

glm::dvec3 GyroModel::rate(std::size_t k) const {
  const Frame &a = frames_[k - 1], &b = frames_[k];
  return rotation_vector(orthonormal(turn_between(a.attitude, b.attitude))) / (b.time - a.time);
}

bool GyroModel::trusted() const {
  return turned_ < kLeastTurned || otherwise_ < kMostOtherwise * turned_;
}

std::optional<Attitude> GyroModel::add(double time, const glm::dmat3& camera_from_rest) {
  if (!frames_.empty() && !(time > frames_.back().time)) frames_.pop_back();
  if (!frames_.empty() && time - frames_.back().time > options_.longest_gap) frames_.clear();
  frames_.push_back({time, camera_from_rest});
  if (frames_.size() > 4) frames_.pop_front();
  if (frames_.size() == 4) compare();
  if (!trusted()) return std::nullopt;
  const double prior = 1 / (options_.delay_deviation * options_.delay_deviation);
  variance_ = 1 / (information_ + prior), delay_ = sum_ * variance_;
  const std::size_t n = frames_.size();
  if (n < 2) return Attitude{camera_from_rest, 0};
  // The rate at the frame itself: that of the last interval and half of its change.
  glm::dvec3 now = rate(n - 1), change = now;
  if (n > 2) {
    change = now - rate(n - 2);
    now += change * ((time - frames_[n - 2].time) / (time - frames_[n - 3].time));
  }
  const double off = kRateError * delay_;
  return Attitude{orthonormal(rotation_from_vector(delay_ * now) * camera_from_rest),
                  (variance_ + off * off) * glm::dot(change, change) / 3};
}

void GyroModel::add_board(const glm::dmat3& camera_from_marker, double variance) {
  if (frames_.empty()) return;
  frames_.back().board = camera_from_marker, frames_.back().variance = variance;
}

void GyroModel::compare() {
  const Frame &a = frames_[1], &b = frames_[2];
  if (!a.board || !b.board) return;
  const double before = a.time - frames_[0].time, step = b.time - a.time,
               after = frames_[3].time - b.time;
  const glm::dvec3 r1 = rate(1), r2 = rate(2), r3 = rate(3);
  const glm::dvec3 at_a = (r1 * step + r2 * before) / (step + before),
                   at_b = (r2 * after + r3 * step) / (after + step);
  const glm::dmat3 told = turn_between(a.attitude, b.attitude),
                   seen = turn_between(*a.board, *b.board);
  const glm::dvec3 difference = rotation_vector(orthonormal(turn_between(told, seen)));
  const glm::dvec3 change = at_b - told * at_a;
  const double noise = a.variance + b.variance + kLeastNoise * kLeastNoise;
  const glm::dvec3 left = difference - delay_ * change;
  const double turn =
      std::max(glm::length(r2) * step, glm::length(rotation_vector(orthonormal(seen))));
  if (turn > kTurns && turn * turn > kClear * 3 * noise) {
    turned_ = kForget * turned_ + 1;
    // Minus the part from noise, which averages out.
    const double share = (glm::dot(left, left) - 3 * noise) / (turn * turn);
    otherwise_ = kForget * otherwise_ + std::clamp(share, -1.0, 1.0);
  }
  const double expected = noise + variance_ * glm::dot(change, change) / 3;
  const double off = std::sqrt(glm::dot(left, left) / (3 * expected));
  const double weight = off > kOutlier ? kOutlier / off : 1;
  information_ = kForget * information_ + weight * glm::dot(change, change) / noise;
  sum_ = kForget * sum_ + weight * glm::dot(change, difference) / noise;
}

}  // namespace fastibl
