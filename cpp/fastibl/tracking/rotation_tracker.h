// Tells where a rig looks while the board is out of view: its rotation against the captured map
// (Wagner, Mulloni, Langlotz and Schmalstieg 2010, Real-time panoramic mapping and tracking on
// mobile phones), in linear light of any exposure and without keyframes.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/map_surface.h"
#include "fastibl/scene/picture.h"
#include "fastibl/tracking/align_rotation.h"
#include "fastibl/tracking/light_pyramid.h"
#include "fastibl/tracking/map_features.h"
#include "fastibl/tracking/picture_features.h"

namespace fastibl {

struct RotationTrackingOptions {
  AlignmentOptions alignment;
  double acceleration = 6;  // rad/s², standard deviation of a hand's acceleration
  // For a gyroscope's turns: rad/√s by which they drift (random walk), and the share by which they
  // are too long or too short.
  double gyro_noise = 0.002, gyro_scale = 0.005;
  double largest_error = 1;  // degrees; above this stated deviation of the rotation, there is none
  double largest_residual = 1.0;  // of Alignment::residual; 0.5 is usual
  double least_agreeing = 0.85;   // of Alignment::agreeing; 0.97 is usual
  double longest_gap = 0.5;       // seconds without a result, after which the rotation is lost
  // Metres/√s by which the camera's place is assumed to wander unseen (standard deviation).
  double wander = 0.05;
  // Degrees: a picture whose own rotation is less sure gives no features of its own.
  double sure = 0.15;
};

// Pictures of one moment; either may be empty.
struct RigPictures {
  Picture back, front;
  double back_exposure = 1, front_exposure = 1;
  // Number of the moment: pictures of the same moment as in the previous call are not processed
  // again.
  std::uint64_t number = 0;            // 0: not known
  std::optional<glm::dvec3> velocity;  // see Turned; where it is known from elsewhere
};

// A pose that rests on the map and not on the board: the rotation is measured, and the camera's
// place is where the board was last seen from, moved as near surroundings show. Where nothing of
// the map is to be seen, residual, agreeing and gains are 0, 0 and 1.
struct Turned {
  Pose back_from_marker;
  // Covariance of w, where the true rotation is exp([w]×) R: rad², back camera's frame, row major;
  // against the marker, including the drift of the map.
  std::array<double, 9> covariance{};
  double drift = 0;               // standard deviation of the map's own rotation there, radians
  double position_deviation = 0;  // metres
  double residual = 0;            // see Alignment; near 1 where all is as expected
  double agreeing = 0;
  int features = 0;  // 0: by a gyroscope alone, from the last rotation that rested on the map
  // The factor by which each picture is brighter than the map says; 1 where there is none.
  double back_gain = 1, front_gain = 1;
  double since = 0;  // seconds since the pose was last known
  // Angular velocity of the back camera, marker frame, rad/s: t seconds later its rotation is R
  // exp([t velocity]×).
  glm::dvec3 velocity{0};
  bool operator==(const Turned&) const = default;

  double deviation() const {  // of the rotation, radians, over all axes
    return std::sqrt(covariance[0] + covariance[4] + covariance[8]);
  }
  double own_deviation() const {  // the same without the drift of the map
    return std::sqrt(
        std::max(0.0, covariance[0] + covariance[4] + covariance[8] - 3 * drift * drift));
  }
};

enum class Agreement { nothing, agrees, differs };  // nothing: too little to compare

class RotationTracker {
 public:
  explicit RotationTracker(Rig rig, RotationTrackingOptions options = {});

  // Takes a known pose to go on from, and what the pictures show then. Time: seconds, not
  // decreasing. variance: of its rotation, rad², mean over the axes.
  void start(const Pose& back_from_marker, double time, const RigPictures& pictures = {},
             double variance = 0);
  // The rotation at which the pictures agree with the map, as the map was before these pictures
  // were added. turn: now_from_before of the back camera since the last frame, where a gyroscope
  // tells it; turn_variance: its variance, in addition to that by the options, rad². Nothing before
  // a start, or where nothing known is in view, or where that has too little structure or does not
  // agree. After a while of that, the rotation is lost until the next start. With a gyroscope it
  // goes on by that alone, as long as largest_error allows, until the pictures contradict it.
  std::optional<Turned> track(const Environment& environment, const RigPictures& pictures,
                              double time, const std::optional<glm::dmat3>& turn = {},
                              double turn_variance = 0);
  // Whether pictures agree with what was seen before, under a pose that is known otherwise. A fast
  // test.
  Agreement compare(const Pose& back_from_marker, const RigPictures& pictures);
  // Where the things are that the map shows: from elsewhere than its centre, near ones are seen in
  // other directions. What single pictures showed is forgotten if this is new.
  void set_surface(const MapSurface& surface);
  void reset();   // forgets the rotation
  void forget();  // and what was seen
  bool following() const { return state_.has_value(); }

 private:
  // Rotation and angular velocity with their errors (a Kalman filter): the true ones are rotation ·
  // exp([w]×) and velocity + v, marker frame.
  struct State {
    glm::dmat3 rotation{1.0};  // back_from_marker
    glm::dvec3 velocity{0};    // rad/s: rotation · exp([velocity · t]×)
    glm::dmat3 ww{0.0}, wv{0.0}, vv{0.0};
    double time = 0;
    glm::dvec3 told{0};  // turn by a gyroscope since the last correction, radians
  };
  State predicted(double time, const std::optional<glm::dmat3>& turn, double variance) const;
  static void correct(State& state, const glm::dmat3& rotation, const glm::dmat3& covariance);
  // Before anything is changed: throws std::invalid_argument for pictures of other sizes.
  void check_pictures(const RigPictures& pictures) const;
  std::vector<MapView> views(const RigPictures& pictures, const State* state,
                             const Pose& back_from_marker);
  void add_features(const std::vector<MapView>& views);
  std::optional<Turned> judged(const Alignment& found, double time) const;
  bool is_only_one(const Alignment& found, const RotationPrior& prior,
                   const std::vector<MapView>& seen) const;
  std::optional<Turned> turned(const Pose& back_from_marker, const glm::dmat3& covariance,
                               double drift, double time) const;

  Rig rig_;
  RotationTrackingOptions options_;
  Lens back_lens_;
  std::optional<Lens> front_lens_;
  LightPyramid back_light_, front_light_;
  std::uint64_t lit_ = 0;  // RigPictures::number of these pictures
  BlockRays back_rays_;
  std::optional<BlockRays> front_rays_;
  MapFeatures features_;
  PictureFeatures fine_;
  MapSurface surface_;
  std::optional<State> state_;  // of the last frame, whether or not it gave a result
  glm::dvec3 eye_{0};           // of the back camera, marker frame, metres
  glm::dmat3 place_{0.0};       // covariance of that since a pose was known, metres²
  double known_ = 0;            // seconds: when a pose was last known
  double found_ = 0;            // and when one was last found
  // Variances of the drift: of what is seen now, and of the map where a rotation was last found.
  double last_drift_ = 0, found_drift_ = 0;
  bool contradicted_ = false;  // the gyroscope was, since a rotation was found
};

}  // namespace fastibl
