#include "fastibl/tracking/roll_corners.h"

#include <algorithm>
#include <cmath>

#include "fastibl/tracking/fit_edges.h"
#include "fastibl/core/solve.h"

namespace fastibl {
namespace {

constexpr std::size_t kLeastTags = 3;
constexpr int kRounds = 6;

// Each corner as two short edges, across x and across y.
std::vector<EdgePoint> points_of(const Tracked& tracked, const Board& board, const Lens& lens,
                                 const Pose& pose, const Rows& rows, double noise) {
  std::vector<EdgePoint> points;
  for (const DetectedTag& tag : tracked.tags) {
    const Tag* on_board = board.find(tag.id);
    if (!on_board) continue;
    for (std::size_t i = 0; i < 4; ++i) {
      const glm::dvec2 place = on_board->corners[i];
      const auto seen =
          rows.project(lens, pose * glm::dvec3(place, 0), rows.later(tag.corners[i].y));
      if (!seen) continue;
      for (int axis = 0; axis < 2; ++axis) {
        EdgePoint& point = points.emplace_back();
        point.point = place, point.pixel = seen->pixel, point.noise = noise;
        point.normal[axis] = 1, point.offset = tag.corners[i][axis] - seen->pixel[axis];
      }
    }
  }
  return points;
}

double rms(std::span<const EdgePoint> points) {
  double sum = 0;
  for (const EdgePoint& p : points) sum += p.offset * p.offset;
  return std::sqrt(2 * sum / double(points.size()));
}

}  // namespace

RowPrior unknown_hand(const Pose& start, double readout) {
  const double t = readout, t2 = t * t;
  return unknown_motion(start, {}, {kHandSpeed.turn * t, kHandSpeed.shift * t},
                        {kHandAcceleration.turn * t2, kHandAcceleration.shift * t2},
                        hand_jerk(readout));
}

void roll_corners(const Board& board, const Camera& camera, double noise, Tracked& tracked) {
  if (tracked.tags.size() < kLeastTags) return;
  const Lens lens(camera);
  Pose pose = tracked.camera_from_marker;
  Rows rows{{}, 0, double(camera.height)};
  double sum = 0;
  for (const DetectedTag& tag : tracked.tags)
    for (const glm::dvec2& corner : tag.corners) sum += corner.y;
  rows.share = sum / (4 * double(tracked.tags.size()) * camera.height);
  const RowPrior prior = unknown_hand(pose, camera.readout);
  std::optional<EdgeFit> fit;
  for (int round = 0; round < kRounds; ++round) {
    fit = fit_edges(points_of(tracked, board, lens, pose, rows, noise), lens, pose, rows, prior);
    if (!fit) return;
    pose = fit->camera_from_marker, rows.motion = fit->row_motion;
  }
  const double residual = rms(points_of(tracked, board, lens, pose, rows, noise));
  // The points' own scatter is their deviation; it is at least noise.
  double smallest = 1e9;
  for (const float d : fit->deviation) smallest = std::min(smallest, double(d));
  const double variance = std::max(1.0, noise * noise / (smallest * smallest));
  std::array<double, 36> known{};
  if (!(residual <= tracked.residual_px) || !invert<6>(fit->information, known)) return;
  for (double& c : known) c *= variance;
  const auto covariance = joint_covariance(fit->row_information, variance, known);
  if (!covariance) return;
  const RowState state = state_of_row({pose, rows.motion, *covariance}, -rows.share);
  tracked.camera_from_marker = state.pose, tracked.residual_px = residual;
  tracked.last_row = state.motion.moved(state.pose, 1);
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k)
      tracked.covariance[6 * i + k] = state.covariance[kRowParameters * i + k];
}

}  // namespace fastibl
