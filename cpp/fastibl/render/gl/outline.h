// Finds which pixels the object and its shadow can touch. Private to render/gl.
#pragma once

#include <algorithm>

#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/mesh.h"

namespace fastibl {

// Pixels [x0, x1) × [y0, y1).
struct Area {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool empty() const { return x0 >= x1 || y0 >= y1; }
  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
  Area united(const Area& b) const {
    if (empty()) return b;
    if (b.empty()) return *this;
    return {std::min(x0, b.x0), std::min(y0, b.y0), std::max(x1, b.x1), std::max(y1, b.y1)};
  }
};

struct Outline {
  Area area;           // holds every pixel that the mesh can cover
  bool whole = false;  // the whole mesh lies before the camera and within the lens model
  double nearest = 0, farthest = 1;  // depths that enclose the mesh, metres, 0 < nearest < farthest
};
Outline outline_of(const Mesh& mesh, const Camera& camera, const Pose& camera_from_object);

// Outline of the square [centre − extent, centre + extent] on the marker plane.
Area outline_of_plane(glm::vec2 centre, float extent, const Camera& camera,
                      const Pose& camera_from_marker);

}  // namespace fastibl
