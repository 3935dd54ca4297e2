// A small motion of the camera from measured edges, robustly.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "fastibl/scene/camera.h"
#include "fastibl/tracking/edge_points.h"

namespace fastibl {

struct EdgeFit {
  Pose camera_from_marker;
  std::array<double, 36> information{};  // of (w, d) as Tracked::covariance; its inverse is that
  double residual = 0;                   // px: median distance of the points from the fitted edges
  double growth = 0;  // px: by which all white has shrunk; negative where it has grown; else 0
  double motion = 0;  // px: by how much the fit moved the points, root mean square
  std::vector<float> deviation;  // px: of each point, from the scatter of its kind
  std::vector<bool> used;        // points that agree
  std::vector<float> left;       // px: of each point from its fitted edge, along its normal
  // Of a rolling shutter: the rows' motion, and what is known of it and of the pose together;
  // `information` is then that of a known motion.
  RowMotion row_motion;
  UnknownMatrix row_information{};
};

// Where on the board the points lie that a fit used: least and largest x and y, marker frame.
struct UsedRange {
  glm::dvec2 low{1e9}, high{-1e9};
  UsedRange(std::span<const EdgePoint> points, const EdgeFit& fit);
};

// By a turn w and a shift d in the camera frame.
Pose moved(const Pose& pose, const std::array<double, 6>& x);

// Moves `pose`, by which the points were measured, so that the edges lie where they were found:
// weighted least squares of the distances across the edges, with Tukey's biweight at 4.685 times
// the points' own scatter. Linear about `pose`: measure again and repeat until nothing moves.
// Where all edges lie towards white, or towards black, paper was overexposed or ink has run: then
// that is found along with the motion. Nothing for fewer than 8 points or where they leave a motion
// open.
std::optional<EdgeFit> fit_edges(std::span<const EdgePoint> points, const Lens& lens,
                                 const Pose& pose);

// The same for a rolling shutter, with the motion of its rows. What the edges leave open is settled
// by what is expected: of a plane, pose and motion are told apart by less than a pixel.
std::optional<EdgeFit> fit_edges(std::span<const EdgePoint> points, const Lens& lens,
                                 const Pose& pose, const Rows& rows, const RowPrior& prior);

// What the points alone say of pose and motion, which measured them: the normal equations of a
// change of all parameters.
struct RowEvidence {
  UnknownMatrix information{};
  RowVector change{};  // information times the change that the points ask for
};
std::optional<RowEvidence> row_evidence(std::span<const EdgePoint> points, const Lens& lens,
                                        const Pose& pose, const Rows& rows);

// The points as a global shutter shows them that takes the whole picture with the row of the pose.
std::vector<EdgePoint> unrolled(std::span<const EdgePoint> points, const Lens& lens,
                                const Pose& pose, const Rows& rows);

// Sum of squared distances of the found edges from where a pose puts them, by their deviations,
// each at most as far as counts; of the points that the fit used.
double edge_cost(std::span<const EdgePoint> points, const EdgeFit& fit, const Lens& lens,
                 const Pose& pose);

// Levenberg–Marquardt on the same distances from a pose far from where they were measured.
std::optional<Pose> refit_edges(std::span<const EdgePoint> points, const EdgeFit& fit,
                                const Lens& lens, const Pose& start);

}  // namespace fastibl
