// Whether a picture may show something at all, so that what it cannot show need not be made.
#pragma once

#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/shading/cut_to_view.h"

namespace fastibl {

// What a perspective camera sees, and a tenth of the picture's size around.
class PictureView {
 public:
  explicit PictureView(const Camera& camera) : camera_(camera), sides_(picture_sides(camera)) {}
  const Camera& camera() const { return camera_; }

  // False where no part of a box, or of the square [centre − extent, centre + extent] of the plane
  // z = 0, can be in the picture.
  bool may_show(const Bounds& box, const Pose& camera_from_box) const;
  bool may_show(glm::vec2 centre, float extent, const Pose& camera_from_plane) const;

 private:
  bool meets(std::vector<glm::dvec3> polygon) const;

  Camera camera_;
  std::vector<ViewPlane> sides_;
};

}  // namespace fastibl
