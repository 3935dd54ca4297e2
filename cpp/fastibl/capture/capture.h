// From camera pictures with known poses to the light of the place.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/pose.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

struct FootprintSample;

struct CaptureOptions {
  int size = 128;              // face edge of the map in texels
  std::optional<Board> board;  // its page is masked: the plane there is filled from around it
  glm::dvec3 centre{0, 0,
                    0.05};  // metres, z > 0: where the object stands, from which the plane is seen
  // Metres from `centre` to what is seen above the horizon: light from there is put where the
  // object sees it, not where the camera does. Infinite: all light is distant.
  double distance = std::numeric_limits<double>::infinity();
  double plane_albedo = 0.5;  // of the plane where no camera saw it: radiance albedo · E(z)/π
};

// Measures the environment: every picture updates the texels that it sees. Above the horizon light
// comes from `distance`; below it a texel is the point of the opaque marker plane that `centre`
// sees there.
//
// Each channel of a texel is a value with a variance (a Kalman filter per texel): noise of the
// sensor and of quantisation, grown with time, decide how much a new sample counts; a sample that
// contradicts the value replaces it. A clipped sample is a lower bound: it raises a value below it,
// agrees with one above it and never lowers it.
class Capture {
 public:
  explicit Capture(
      CaptureOptions options = {});  // throws std::invalid_argument for options out of range

  // time: seconds, not decreasing. mask: one byte a pixel, 0 where the picture shows what is not
  // part of the place; empty for none. Throws std::invalid_argument for a picture or mask of
  // another size than the camera's, an exposure that is not positive and finite, or a time before
  // the last one.
  void add(const Picture& picture, const Camera& camera, const Pose& camera_from_marker,
           double exposure, double time, ImageView<const std::uint8_t> mask = {});

  // The map at the time of the last picture, without holes: unseen texels take the nearest seen
  // value on their side of the horizon, at confidence 0.
  std::shared_ptr<const Environment> environment();

  int size() const { return options_.size; }
  double time() const { return time_; }
  // 6 n²: time at which each texel was last seen; −∞ if never.
  const std::vector<double>& last_seen() const { return last_seen_; }

 private:
  class SensorNoise;
  void merge(std::size_t texel, const FootprintSample& seen, float pixels,
             float radiance_per_linear, const SensorNoise& noise);
  void update_nearest();

  CaptureOptions options_;
  double time_ = -1e30;
  std::vector<glm::vec3> directions_;  // unit
  std::vector<float> solid_angle_;     // n², one face
  std::vector<glm::vec3> value_, variance_;
  std::vector<std::uint8_t> bound_;  // bit c: channel c is only a lower bound
  std::vector<double> last_seen_;
  std::vector<std::array<int, 4>> neighbours_;
  std::vector<int> nearest_;  // index of the texel whose value an unseen one takes; −1: none
  bool coverage_changed_ = true;
};

}  // namespace fastibl
