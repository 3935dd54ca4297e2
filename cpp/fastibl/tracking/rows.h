// Where a rolling shutter shows what moves past the camera, as told by the pose of one row.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "fastibl/scene/camera.h"
#include "fastibl/scene/row_motion.h"

namespace fastibl {

// The rows of one picture. `motion` is in the camera frame of the row of the pose.
struct Rows {
  RowMotion motion;
  double share = 0;   // of the readout: when the row of the pose is taken
  double height = 1;  // of the picture, px

  // How much later than the row of the pose what lies at y is taken, as a share of the readout.
  double later(double y) const { return (y - 0.5) / height - share; }
  // Pixel of a point in the camera frame of that row. later: a guess of how much later it is seen;
  // afterwards what it is.
  std::optional<glm::dvec2> project(const Lens& lens, const glm::dvec3& point, double& later) const;
};

// The parameters of a pose and of the rows' motion: (w, d) as Tracked::covariance, (w', d') by
// which it grows in a readout, and (w'', d'') by which that does. Row major.
inline constexpr std::size_t kRowParameters = 18;
using RowVector = std::array<double, kRowParameters>;
using RowMatrix = std::array<double, kRowParameters * kRowParameters>;

struct RowState {
  Pose pose;  // of the first row
  RowMotion motion;
  RowMatrix covariance{};
};

// Standard deviations of what changes a motion, about and along any axis: radians and metres.
struct Unsteadiness {
  double turn = 0, shift = 0;
};

// The same for a row that is `share` later.
RowState state_of_row(const RowState& state, double share);

// After a time of `steps` readouts, in which the accelerations grew by an unknown constant jerk of
// `jerk` per cubed readout.
RowState after(const RowState& state, double steps, const Unsteadiness& jerk);

// What the rows of a picture are expected to be; of what is not known, the information is 0.
struct RowPrior {
  Pose pose;
  RowMotion motion;
  RowMatrix information{};
};
// A pose and a motion of which nothing is known but how fast hands are.
RowPrior unknown_motion(const Pose& start, const RowMotion& motion, const Unsteadiness& speed,
                        const Unsteadiness& acceleration);
std::optional<RowPrior> prior_of(const RowState& state);
RowPrior prior_of_row(const RowPrior& prior, double share);

// Of the information of a fit, whose unit is `variance`, with another covariance (w, d) of the pose
// for a known motion.
std::optional<RowMatrix> joint_covariance(const RowMatrix& information, double variance,
                                          const std::array<double, 36>& of_known_motion);

// By how much `to` differs from `from`, of a board at `place` in the camera frame, and the motion
// after such a change: (w', d', w'', d'').
std::array<double, 12> difference(const RowMotion& to, const RowMotion& from,
                                  const glm::dvec3& place);
RowMotion changed(const RowMotion& motion, std::span<const double, 12> x, const glm::dvec3& place);

}  // namespace fastibl
