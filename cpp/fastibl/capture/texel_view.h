// Which texels of the map a picture sees, and where.
#pragma once

#include <optional>

#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

// Where the map is seen from, and what it shows: see CaptureOptions.
struct Viewpoint {
  glm::dvec3 centre;
  double distance;  // metres to what is above the horizon; may be infinite
  glm::dvec2 masked{
      -1, -1};  // half width and height of the plane's part around the origin to leave out
};

struct Sighting {
  glm::dvec2 pixel;
  float area;  // pixels that the texel covers
};

class TexelView {
 public:
  TexelView(const Camera& camera, const Pose& camera_from_marker, const Viewpoint& viewpoint);

  // direction: unit, marker frame, from the viewpoint. solid_angle: of the texel as seen from
  // there.
  std::optional<Sighting> see(const glm::dvec3& direction, double solid_angle) const;

  // False where no texel of the tile [x0, x1) × [y0, y1) of a face can be seen; true says nothing.
  bool may_see(int face, int x0, int y0, int x1, int y1, int size) const;

 private:
  Camera camera_;
  Lens lens_;
  Viewpoint viewpoint_;
  glm::dmat3 rotation_;  // marker to camera
  glm::dvec3 centre_;    // the viewpoint in the camera frame
  double height_;        // of the camera above the plane
  double nearness_;      // 1 / distance
  glm::vec3 axis_;       // optical axis, marker frame
  float reach_;          // largest angle between it and a texel above the horizon that is seen
};

}  // namespace fastibl
