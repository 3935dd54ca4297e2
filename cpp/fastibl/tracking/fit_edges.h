// Fits a small motion of the camera to measured edges, robustly.
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
  std::array<double, 36> information{};  // of (w, d) as Tracked::covariance, which is its inverse
  double residual = 0;                   // px: median distance of the points from the fitted edges
  double growth = 0;  // px: how much all white has shrunk; negative where it has grown; else 0
  double motion = 0;  // px: how far the fit moved the points, root mean square
  std::vector<float> deviation;  // px: for each point, from the scatter of its kind
  std::vector<bool> used;        // whether each point agrees
  std::vector<float> left;  // px: distance of each point from its fitted edge, along its normal
  // For a rolling shutter: the rows' motion, and what is known of it and of the pose together;
  // `information` is then for a known motion.
  RowMotion row_motion;
  UnknownMatrix row_information{};
};

// The range of the points on the board that a fit used: least and largest x and y, marker frame.
struct UsedRange {
  glm::dvec2 low{1e9}, high{-1e9};
  UsedRange(std::span<const EdgePoint> points, const EdgeFit& fit);
};

// `pose` moved by a turn w and a shift d in the camera frame.
Pose moved(const Pose& pose, const std::array<double, 6>& x);

// Moves `pose`, with which the points were measured, so that the edges lie where they were found:
// weighted least squares of the distances across the edges, with Tukey's biweight at 4.685 times
// the points' own scatter. It is linear about `pose`: measure again and repeat until nothing moves.
// If all edges lie towards white, or all towards black, the paper was overexposed or the ink has
// run; that is then found along with the motion. Nothing for fewer than 8 points or where they
// leave a motion open.
std::optional<EdgeFit> fit_edges(std::span<const EdgePoint> points, const Lens& lens,
                                 const Pose& pose);

// The same for a rolling shutter, with the motion of its rows. What the edges leave open is settled
// by what is expected: with a plane, pose and motion differ in the picture by less than a pixel.
std::optional<EdgeFit> fit_edges(std::span<const EdgePoint> points, const Lens& lens,
                                 const Pose& pose, const Rows& rows, const RowPrior& prior);

// What the points alone say about the pose and motion with which they were measured: the normal
// equations of a change of all parameters.
struct RowEvidence {
  UnknownMatrix information{};
  RowVector change{};  // information times the change that the points ask for
};
std::optional<RowEvidence> row_evidence(std::span<const EdgePoint> points, const Lens& lens,
                                        const Pose& pose, const Rows& rows);

// The points as a global shutter would show them that takes the whole picture at the time of the
// pose's row.
std::vector<EdgePoint> unrolled(std::span<const EdgePoint> points, const Lens& lens,
                                const Pose& pose, const Rows& rows);

// Sum of squared distances of the found edges from where a pose puts them, each divided by its
// deviation and limited to the distance up to which it counts; over the points that the fit used.
double edge_cost(std::span<const EdgePoint> points, const EdgeFit& fit, const Lens& lens,
                 const Pose& pose);

// Levenberg–Marquardt on the same distances, from a pose far from where they were measured.
std::optional<Pose> refit_edges(std::span<const EdgePoint> points, const EdgeFit& fit,
                                const Lens& lens, const Pose& start);

}  // namespace fastibl
