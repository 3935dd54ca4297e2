// What the examples light and where they look from: a pyramid on the marker plane.
#pragma once

#include <fastibl/core/pose.h>
#include <fastibl/scene/camera.h>
#include <fastibl/scene/cube_map.h>
#include <fastibl/scene/mesh.h>

#include <cmath>

// Grey all around, with a warm sun 30° wide in the given direction.
inline fastibl::CubeMap sky(glm::vec3 towards_sun) {
  const int size = 32;
  const glm::vec3 sun = glm::normalize(towards_sun);
  fastibl::CubeMap map(size);
  for (int face = 0; face < 6; ++face)
    for (int y = 0; y < size; ++y)
      for (int x = 0; x < size; ++x) {
        const glm::vec3 d = glm::normalize(fastibl::texel_direction(face, x, y, size));
        map.base().texel(face, x, y) =
            glm::dot(d, sun) > std::cos(0.26f) ? glm::vec3(10, 8, 6) : glm::vec3(0.5f);
      }
  map.update();
  return map;
}

// A pyramid 10 cm wide and high.
inline fastibl::Mesh pyramid() {
  fastibl::Mesh mesh;
  mesh.vertices = {
      {-.05f, -.05f, 0}, {.05f, -.05f, 0}, {.05f, .05f, 0}, {-.05f, .05f, 0}, {0, 0, .1f}};
  mesh.triangles = {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}, {0, 2, 1}, {0, 3, 2}};
  return mesh;
}

inline fastibl::Camera camera() {
  fastibl::Camera camera;
  camera.width = 320, camera.height = 240;
  camera.fx = camera.fy = 300;
  camera.cx = 160, camera.cy = 120;
  return camera;
}

// A camera 40 cm away, 45° above the plane. rows: the camera's x right, y down and z forward.
inline fastibl::Pose back_from_marker() {
  const double s = std::sqrt(0.5);
  const glm::dmat3 rows({1, 0, 0}, {0, -s, -s}, {0, s, -s});
  return {glm::transpose(rows), {0, 0.02, 0.4}};
}
