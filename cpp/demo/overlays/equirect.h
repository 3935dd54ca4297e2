// Draws maps as equirectangular insets: z at the top, +y in the middle, x to the right.
#pragma once

#include "demo/overlays/canvas.h"
#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl::demo {

struct Inset {
  glm::ivec2 at;  // upper left
  int height;     // pixels; it is twice as wide
};

// confidence: for each of the map's 6 n² texels; those with 0 are dimmed and striped. Empty: all
// are known. exposure: radiance 1 / exposure is drawn white.
void draw_equirect(Canvas& canvas, const Inset& inset, const CubeMap& map,
                   const std::vector<float>& confidence, double exposure);
// Where a direction lies in the picture.
glm::dvec2 in_equirect(const Inset& inset, const glm::dvec3& direction);
glm::vec3 equirect_direction(const Inset& inset, int x, int y);  // x, y: a pixel of the inset
// Draws the border of what a camera sees.
void draw_field(Canvas& canvas, const Inset& inset, const Camera& camera,
                const Pose& camera_from_marker, Colour colour);
// Draws the short way from one direction to another.
void draw_way(Canvas& canvas, const Inset& inset, const glm::dvec3& from, const glm::dvec3& to,
              Colour colour);

}  // namespace fastibl::demo
