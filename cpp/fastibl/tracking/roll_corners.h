// Poses from corners that a rolling shutter shows.
#pragma once

#include "fastibl/tracking/rows.h"
#include "fastibl/tracking/tracker.h"

namespace fastibl {

// For a hand about which nothing is known: standard deviations of speed, acceleration and jerk;
// radians and metres, by seconds.
inline constexpr Unsteadiness kHandSpeed{0.7, 0.25}, kHandAcceleration{5, 2.5}, kHandJerk{100, 50};
inline Unsteadiness hand_jerk(double readout) {
  const double cubed = readout * readout * readout;
  return {kHandJerk.turn * cubed, kHandJerk.shift * cubed};
}
RowPrior unknown_hand(const Pose& start, double readout);

// Corrects a pose that took the corners of `tracked.tags` as seen at once: it becomes the pose of
// the first row, and the pose of the last row is added, as far as the corners tell the motion.
// noise: the least deviation of a corner, px. Does nothing with fewer than three tags, or where the
// motion fits no better.
void roll_corners(const Board& board, const Camera& camera, double noise, Tracked& tracked);

}  // namespace fastibl
