// Model-based edge tracking: the pose of one frame predicts where the next one shows the edges of
// the board's tags; their distances from there, measured in linear light, correct it. About ten
// times as accurate as corners, at a tenth of the time of detection.
#pragma once

#include <optional>

#include "fastibl/scene/picture.h"
#include "fastibl/tracking/light_reader.h"
#include "fastibl/tracking/rows.h"
#include "fastibl/tracking/tag_edges.h"
#include "fastibl/tracking/tracker.h"

namespace fastibl {

struct EdgeTrackingOptions {
  std::size_t most_edges = 600;  // measured in a round; more are thinned out evenly
  int most_rounds = 5;           // of measuring and fitting, from close by
  double search_px = 64;         // how far a tag may lie from its prediction, by its code
  double largest_error = 1.0;    // degrees; stated deviation of the rotation: beyond, there is none
  double longest_gap = 0.25;     // seconds between frames: beyond, nothing is predicted
  // Seconds; the pose that is given out follows as through a low-pass filter of this time constant,
  // and lags behind a steady motion by as much. 0: none. What is tracked stays unfiltered.
  double smoothing = 0;
  // Down in the marker frame, for the choice between two minima where a frame brings gravity: of a
  // board that lies on a table. Null: unknown.
  glm::dvec3 gravity_in_marker{0, 0, -1};
};

// What other sensors of the camera say, in its frame. All optional.
struct MotionHint {
  std::optional<glm::dmat3> turn;     // now_from_before, since the last frame with a pose
  std::optional<glm::dvec3> gravity;  // downwards, any length
};

// What a pose is expected to be before the picture is looked at.
struct PosePrior {
  std::optional<glm::dmat3> rotation;  // camera_from_marker
  double deviation = 0.05;             // of it, radians
  std::optional<glm::dvec3> gravity;   // in the camera frame, unit length
  glm::dvec3 gravity_in_marker{0, 0, -1};
  std::optional<RowPrior> rows;  // of a rolling shutter's first row
  // The start is by corners. Few edges lead from there to the pose; from a predicted one they may
  // lead elsewhere.
  bool by_corners = false;
};

// What tracking by edges needs of a board and a camera, worked out once.
class EdgeModel {
 public:
  EdgeModel(const Board& board, const Camera& camera);
  // The pose near `start` that the picture's edges agree with, both of the first row where the
  // camera has a readout; the rows' motion is fitted with it. Nothing where too few tags show their
  // codes there, or the pose stays uncertain. picture: 1 or 3 channels, encoded, of the camera's
  // size.
  // state: null, or where to put what a rolling shutter's picture tells of pose and motion
  // together.
  std::optional<Tracked> track(ImageView<const std::uint8_t> picture, const Pose& start,
                               const PosePrior& prior, const EdgeTrackingOptions& options,
                               RowState* state = nullptr) const;

 private:
  BoardPattern pattern_;
  Camera camera_;
  Lens lens_;
  LightTable grey_, colour_;
};

// Follows a board from frame to frame. Its state: the last pose, when it was, and how fast it
// moved.
class EdgeTracker {
 public:
  EdgeTracker(const Board& board, const Camera& camera, EdgeTrackingOptions options = {});

  // time: seconds, not decreasing; null: one frame after the last. Predicts, or where that fails or
  // there is nothing to predict from, detects. Nothing where neither finds the board: never an old
  // pose.
  std::optional<Tracked> track(const Picture& picture, std::optional<double> time,
                               const Detector& detector, const MotionHint& hint = {});
  void reset() { last_.reset(), before_.reset(), shown_.reset(); }
  bool following() const { return last_.has_value(); }

 private:
  struct Moment {
    Pose pose;
    double time = 0;
  };
  Pose predicted(double time, const MotionHint& hint) const;
  // By the pose and motion of a rolling shutter's last picture; also sets prior.rows.
  Pose predicted_rows(double time, const MotionHint& hint, PosePrior& prior) const;
  std::optional<Tracked> detect(const Picture& picture, ImageView<const std::uint8_t> bytes,
                                const PosePrior& prior, const Detector& detector);
  void smooth(Tracked& tracked, double time);

  Board board_;
  Camera camera_;
  EdgeTrackingOptions options_;
  EdgeModel model_;
  std::optional<Moment> last_, before_, shown_;
  double clock_ = 0;  // seconds: of the last picture, whatever it showed
  RowState rows_;     // at last_, of a rolling shutter
};

}  // namespace fastibl
