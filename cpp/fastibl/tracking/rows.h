// Tells where a rolling shutter shows what moves past the camera, given the pose of one row.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "fastibl/scene/camera.h"
#include "fastibl/scene/row_motion.h"

namespace fastibl {

// The rows of one picture. `motion` is in the camera frame of the row that the pose belongs to.
struct Rows {
  RowMotion motion;
  double share = 0;   // of the readout: when the pose's row is taken
  double height = 1;  // of the picture, px

  // How much later than the pose's row the light at y is taken, as a share of the readout.
  double later(double y) const { return (y - 0.5) / height - share; }
  struct Seen {
    glm::dvec2 pixel, flow;  // flow: of the point past the camera, pixels per readout
    double later = 0;
  };
  // Projects a point in the camera frame of that row. guess: of how much later it is seen.
  std::optional<Seen> project(const Lens& lens, const glm::dvec3& point, double guess) const;
  // The same where the flow is known within a tenth and the guess is close, at half the cost.
  std::optional<glm::dvec2> project(const Lens& lens, const glm::dvec3& point, double guess,
                                    const glm::dvec2& flow) const;
};

// The parameters of a pose and of the rows' motion: (w, d) as Tracked::covariance; (w', d'), the
// growth of these in a readout; and (w'', d''), the growth of those. Row major.
inline constexpr std::size_t kRowParameters = 18;
using RowMatrix = std::array<double, kRowParameters * kRowParameters>;
// The same and a jerk, the growth of the accelerations. It is not kept, but makes pictures of a
// trembling hand tell less about the rest.
inline constexpr std::size_t kRowUnknowns = 24;
using RowVector = std::array<double, kRowUnknowns>;
using UnknownMatrix = std::array<double, kRowUnknowns * kRowUnknowns>;

struct RowState {
  Pose pose;  // of the first row
  RowMotion motion;
  RowMatrix covariance{};
};

// Standard deviations of changes of a motion, about and along any axis: radians and metres.
struct Unsteadiness {
  double turn = 0, shift = 0;
};

// The same for a row that is `share` later.
RowState state_of_row(const RowState& state, double share);

// The state after `steps` readouts, in which the accelerations grew by an unknown constant jerk of
// `jerk` per cubed readout.
RowState after(const RowState& state, double steps, const Unsteadiness& jerk);

// The expected rows of a picture; the information of what is not known is 0.
struct RowPrior {
  Pose pose;
  RowMotion motion;
  RowMatrix information{};
  Unsteadiness jerk;  // per cubed readout
};
// A pose and a motion about which nothing is known but how fast hands are.
RowPrior unknown_motion(const Pose& start, const RowMotion& motion, const Unsteadiness& speed,
                        const Unsteadiness& acceleration, const Unsteadiness& jerk);
std::optional<RowPrior> prior_of(const RowState& state, const Unsteadiness& jerk);
RowPrior prior_of_row(const RowPrior& prior, double share);

// Inverse covariance (6 × 6) of unsteadiness, for a board at `place` in the camera frame.
std::array<double, 36> steadiness(const Unsteadiness& by, const glm::dvec3& place);

// The joint covariance from the information of a fit, whose unit is `variance`, with another
// covariance (w, d) of the pose for a known motion.
std::optional<RowMatrix> joint_covariance(const UnknownMatrix& information, double variance,
                                          const std::array<double, 36>& of_known_motion);

// By how much `to` differs from `from`, for a board at `place` in the camera frame, and the motion
// after such a change: (w', d', w'', d'').
std::array<double, 12> difference(const RowMotion& to, const RowMotion& from,
                                  const glm::dvec3& place);
RowMotion changed(const RowMotion& motion, std::span<const double, 12> x, const glm::dvec3& place);

}  // namespace fastibl
