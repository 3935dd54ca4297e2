// The lens of a fisheye or an equirectangular camera, which may see more than a half space.
#pragma once

#include <optional>

#include "fastibl/scene/camera.h"

namespace fastibl {

class WideLens {
 public:
  explicit WideLens(const Camera& camera);  // throws std::invalid_argument for a perspective one

  // Like those of Camera.
  std::optional<glm::dvec2> project(const glm::dvec3& point) const;
  std::optional<glm::dvec3> unproject(const glm::dvec2& pixel) const;

 private:
  double fx_, fy_, cx_, cy_;
  double k_[4] = {};
  bool fisheye_;
  double limit_;  // radians from the axis up to which a fisheye's model grows and the camera sees
};

}  // namespace fastibl
