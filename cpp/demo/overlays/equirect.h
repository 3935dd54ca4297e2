// Maps drawn equirectangularly as insets: z on top, +y in the middle, x to the right.
#pragma once

#include "demo/overlays/canvas.h"
#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl::demo {

struct Inset {
  glm::ivec2 at;  // upper left
  int height;     // pixels; twice as wide
};

// confidence: of the map's 6 n² texels; what is 0 is dimmed and striped. Empty: all is known.
// exposure: radiance that is drawn white is 1 / exposure.
void draw_equirect(Canvas& canvas, const Inset& inset, const CubeMap& map,
                   const std::vector<float>& confidence, double exposure);
// Where a direction is in the picture.
glm::dvec2 in_equirect(const Inset& inset, const glm::dvec3& direction);
glm::vec3 equirect_direction(const Inset& inset, int x, int y);  // of a pixel of the inset
// The border of what a camera sees.
void draw_field(Canvas& canvas, const Inset& inset, const Camera& camera,
                const Pose& camera_from_marker, Colour colour);
// From one direction to another, the short way.
void draw_way(Canvas& canvas, const Inset& inset, const glm::dvec3& from, const glm::dvec3& to,
              Colour colour);

}  // namespace fastibl::demo
