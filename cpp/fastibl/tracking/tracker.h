// From tags to the pose of the camera in front of the board. These are pure functions: a frame
// without a board has no pose, never an old one.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "fastibl/scene/methods.h"
#include "fastibl/tracking/detector.h"
#include "fastibl/tracking/refine.h"

namespace fastibl {

struct TrackingOptions {
  TrackingMethod method = TrackingMethod::board;  // or frame_marker; the others are EdgeTracker's
  bool refine = true;  // refines corners by refine_corners before the fit; needs the picture
  RefineOptions refining;
  // Expected error of a corner in x or y, with and without refinement: the floor of what counts as
  // a difference between the two minima and, without refinement, of the covariance.
  double refined_noise_px = 0.1;
  double detected_noise_px = 0.5;
  double largest_residual_px = 2;  // plus 2 % of a tag's side: beyond, ids are taken to be wrong
};

struct Tracked {
  // The pose at the picture's time; for a rolling shutter of the first row, the middle of whose
  // exposure is that time.
  Pose camera_from_marker;
  std::optional<Pose> last_row;  // Camera::readout later; nothing for a global shutter
  // RMS distance between seen and expected corners of `tags`; with `edges`, the median distance
  // between seen and expected edges.
  double residual_px = 0;
  // With `edges`: standard deviation in x and y of the places of the board's parts about the fitted
  // ones, beyond their scatter; 0 where the print is flat and as the board says, and the lens is as
  // calibrated. The covariance includes its effect on the pose.
  double misfit_px = 0;
  std::vector<DetectedTag> tags;  // those used, with the corners used or fitted
  int edges = 0;                  // pieces of edges that the pose rests on; 0: it rests on corners
  int pixels = 0;                 // pixels whose light refined it; 0: they could not
  // Covariance of (w, d) in {exp([w]×) R, t + d}: rad², rad m, m²; rotation first, row major,
  // camera frame. It is for the chosen minimum alone: see `ambiguous`.
  std::array<double, 36> covariance{};
  bool ambiguous = false;  // the mirrored pose fits nearly as well
  // Cost of this pose / cost of the mirrored one, each with the expected noise added; 0 where there
  // is no second minimum. What was known before the picture does not count.
  double ambiguity = 0;
  bool operator==(const Tracked&) const = default;
};

// Adds to the covariance that the pose may be another one: a share of their squared difference.
void add_difference(const Pose& other, double share, Tracked& tracked);

// Nothing when no tag of the board is seen, when the tags agree on no pose (wrong ids), or when the
// board would be behind the camera or seen from its back. Ids that are not on the board or are seen
// twice are ignored, and so are tags that disagree with the others.
std::optional<Tracked> track(const Detection& detection, const Board& board, const Camera& camera,
                             const TrackingOptions& options = {});

// The same with the corners refined in the picture, if asked for.
std::optional<Tracked> track(const Detection& detection, ImageView<const std::uint8_t> grey,
                             const Board& board, const Camera& camera,
                             const TrackingOptions& options = {});

// Detects, refines if asked for, and fits: one frame. Throws std::invalid_argument where the
// picture is not grey or not of the camera's size.
std::optional<Tracked> track(const Detector& detector, ImageView<const std::uint8_t> grey,
                             const Board& board, const Camera& camera,
                             const TrackingOptions& options = {});

}  // namespace fastibl
