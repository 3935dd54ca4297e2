// Poses of a plane from point matches: starting poses in closed form, and a robust fit with the
// full lens model.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "fastibl/scene/camera.h"
#include "fastibl/core/solve.h"

namespace fastibl {

// A board point in the marker frame (z = 0) and where it was seen.
struct Match {
  glm::dvec2 point;  // metres
  glm::dvec2 pixel;
  double noise = 1;  // of `pixel` relative to the other matches; errors are divided by it
};

// Huber's loss: quadratic up to `scale`, linear beyond. Tukey's biweight: flat beyond `scale`.
struct Loss {
  enum class Kind { huber, tukey } kind = Kind::huber;
  double scale = 1;  // px
  double cost(double error) const;
  double weight(double error) const;  // of the squared error: cost'(e) / 2e
};

struct PoseFit {
  Pose camera_from_marker;
  double cost = 0;                       // sum of the loss, px²
  std::array<double, 36> information{};  // JᵀWJ: rotation first, row major, px² per unit²
};

// Distance in pixels between where a match is seen and where it should be, divided by its noise;
// infinity where the lens does not show the point.
double error_of(const Match& match, const Lens& lens, const Pose& camera_from_marker);

// Levenberg–Marquardt over the six parameters (w, d) of {exp([w]×) R, t + d}. Nothing when the
// start shows no match or the result is not finite.
std::optional<PoseFit> fit_pose(std::span<const Match> matches, const Lens& lens, const Pose& start,
                                const Loss& loss);

// Pose from the homography of four or more matches, least squares in undistorted coordinates.
// Unlike IPPE, it has no special case for a plane seen fronto-parallel. Nothing for points on a
// line.
std::optional<Pose> pose_from_homography(std::span<const Match> matches, const Lens& lens);

// The other pose, which weak perspective cannot tell from this one: the plane's normal mirrored
// about the direction in which `centre` is seen.
Pose mirrored_pose(const Pose& camera_from_marker, const glm::dvec2& centre);

}  // namespace fastibl
