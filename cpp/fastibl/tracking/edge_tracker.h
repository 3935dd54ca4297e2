// Model-based edge tracking: the pose of one frame predicts where the next one shows the edges of
// the board's tags; their measured distances from there, in linear light, correct it. It is about
// ten times as accurate as corners, in a tenth of the time of detection.
#pragma once

#include <optional>

#include "fastibl/scene/picture.h"
#include "fastibl/tracking/light_reader.h"
#include "fastibl/tracking/rows.h"
#include "fastibl/tracking/tag_edges.h"
#include "fastibl/tracking/tracker.h"

namespace fastibl {

struct EdgeTrackingOptions {
  std::size_t most_edges = 600;  // edges measured in a round; more are thinned out evenly
  int most_rounds = 5;           // rounds of measuring and fitting, from close by
  double search_px = 64;       // how far a tag may lie from its prediction and be found by its code
  double largest_error = 1.0;  // degrees; stated rotation deviation above which there is no pose
  double longest_gap = 0.25;   // seconds between frames; after a longer gap nothing is predicted
  // Seconds; the returned pose follows as through a low-pass filter of this time constant, and lags
  // behind a steady motion by as much. 0: no filter. What is tracked stays unfiltered.
  double smoothing = 0;
  // The direction down in the marker frame, to choose between two minima where a frame brings
  // gravity; the default is for a board that lies on a table. Null: unknown.
  glm::dvec3 gravity_in_marker{0, 0, -1};
};

// What other sensors of the camera tell, in the camera's frame. All optional.
struct MotionHint {
  std::optional<glm::dmat3> turn;     // now_from_before, since the last frame with a pose
  std::optional<glm::dvec3> gravity;  // downwards, any length
};

// The expected pose before the picture is looked at.
struct PosePrior {
  std::optional<glm::dmat3> rotation;  // camera_from_marker
  double deviation = 0.05;             // of the rotation, radians
  std::optional<glm::dvec3> gravity;   // in the camera frame, unit length
  glm::dvec3 gravity_in_marker{0, 0, -1};
  std::optional<RowPrior> rows;  // for a rolling shutter's first row
  // The start is from corners. From there, even few edges lead to the pose; from a predicted start
  // they may lead elsewhere.
  bool by_corners = false;
};

// What tracking by edges needs from a board and a camera, worked out once.
class EdgeModel {
 public:
  EdgeModel(const Board& board, const Camera& camera);
  // The pose near `start` with which the picture's edges agree. Both are of the first row where the
  // camera has a readout; the rows' motion is then fitted with the pose. Nothing where too few tags
  // show their codes there, or the pose stays uncertain. picture: 1 or 3 channels, encoded, of the
  // camera's size.
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

// Follows a board from frame to frame. Its state is the last pose, its time, and how fast it moved.
class EdgeTracker {
 public:
  EdgeTracker(const Board& board, const Camera& camera, EdgeTrackingOptions options = {});

  // time: seconds, not decreasing; null: one frame after the last. Predicts the pose; where that
  // fails or there is nothing to predict from, detects the board. Nothing where neither finds it:
  // never an old pose.
  std::optional<Tracked> track(const Picture& picture, std::optional<double> time,
                               const Detector& detector, const MotionHint& hint = {});
  // Forgets all of that; times start anew.
  void reset() { forget(), clock_ = 0; }
  bool following() const { return last_.has_value(); }

 private:
  struct Moment {
    Pose pose;
    double time = 0;
  };
  void forget() { last_.reset(), before_.reset(), shown_.reset(); }
  Pose predicted(double time, const MotionHint& hint) const;
  // The prediction from the pose and motion of a rolling shutter's last picture; also sets
  // prior.rows.
  Pose predicted_rows(double time, const MotionHint& hint, PosePrior& prior) const;
  std::optional<Tracked> detect(const Picture& picture, ImageView<const std::uint8_t> bytes,
                                const PosePrior& prior, const Detector& detector);
  void smooth(Tracked& tracked, double time);

  Board board_;
  Camera camera_;
  EdgeTrackingOptions options_;
  EdgeModel model_;
  std::optional<Moment> last_, before_, shown_;
  double clock_ = 0;  // seconds: time of the last picture, whatever it showed
  RowState rows_;     // at last_, for a rolling shutter
};

}  // namespace fastibl
