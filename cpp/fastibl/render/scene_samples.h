// Places on an object and on the plane around it, with what rays tell of the sky from there: what
// methods are compared with before one is chosen.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "fastibl/scene/bvh.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

// Of the object as it stood when they were made; seen from all round, but for its turn about z. One
// that is tilted or lifted later is judged as if it still stood so. The frame is that of the
// marker, moved along the plane to where the object stands.
class SceneSamples {
 public:
  static constexpr int kLevelSize = 32;  // face edge of the level whose texels are the directions
  static constexpr int kViews = 8, kViewSamples = 120, kPlaneSamples = 400;
  static constexpr int kPicturePixels = 600, kPicturePlaneSamples = 1600;  // of one picture
  static constexpr int kClose = 10;  // times as many places on the plane without rays
  static constexpr int kViewsFromBelow = 4, kSamplesFromBelow = 60;
  static constexpr float kElevation = 0.65f;  // of the views all round, radians

  struct Surface {
    int corners[3];  // in `vertices`: of the side that is seen
    glm::vec3 weights;
    glm::vec3 position, normal;  // where the object stands; unit, on the side that is seen
    glm::vec3 start;             // of its rays
    glm::vec3 to_eye;            // unit
    int view;                    // in `eyes`
    glm::vec4 tangent;           // see Fragment
    glm::vec2 uv;
    glm::vec3 color;  // of Mesh::colors
  };
  // What views see of the object, each pixel of them equally often: the first `seen` of those that
  // pictures are taken from, the rest of views from below, which tell what the plane sees. Eyes all
  // round and from below are so far away that directions are the same everywhere.
  std::vector<Surface> surface;
  std::size_t seen = 0;
  // Of the seen ones, where each pixel's begin, and their end: those of a picture's pixel that meet
  // the object of the four that it is drawn by. All round each is a pixel of its own, which it
  // fills.
  std::vector<std::size_t> pixels;
  float part = 1;  // of its pixel, that a sample fills
  std::vector<glm::vec3> eyes;
  std::size_t picture_count = 0;  // the first ones; the rest is from below
  // Directions are the texels' centres of a level of kLevelSize, face by face and row by row.
  std::vector<glm::vec3> directions;
  std::vector<float> solid_angles;
  std::vector<std::uint8_t>
      free;  // [sample][direction]: above the tangent plane, and nothing there

  std::vector<glm::vec2> plane;  // places on the plane that a view sees
  // Of each place, in `hidden`, and one more at the end: directions that the object hides.
  std::vector<std::uint32_t> plane_first;
  std::vector<std::uint16_t> hidden;
  std::shared_ptr<const Bvh> bvh;  // of the object as it stands
  glm::vec3 centre{0};             // of the sphere around it
  float radius = 0;
  float above = 0;  // that rays from the plane start, metres
  // Areas in pictures, of the object, and that each place on the plane stands for: m² as a view
  // from afar has them, in the mean over all, or shares of one picture.
  double object_area = 0;
  std::vector<double> plane_areas;
  // Many more, of which no rays are known: where shadows are compared with each other.
  std::vector<glm::vec2> close_plane;
  std::vector<double> close_areas;

  // Of the sides of vertices that samples lie between.
  VertexVisibility visibility;
  std::vector<glm::vec3> vertices, normals;  // mesh frame, of that side
  std::vector<glm::vec3> origins;            // of rays, likewise
  std::vector<float> openness;               // P_V
  glm::mat3 turned{1};                       // by how the object stands, without its turn about z
  double lifted = 0;                         // metres

  std::size_t direction_count() const { return directions.size(); }
  bool empty() const { return seen == 0; }
};

// Seen from all round. Nothing where the directions that the object blocks were not worked out, or
// no view sees it. Some 4 million rays.
std::shared_ptr<const SceneSamples> sample_scene(const Scene& scene);
// As one picture shows it. Nothing where it shows nothing of the object, too.
std::shared_ptr<const SceneSamples> sample_scene(const Scene& scene, const Camera& camera,
                                                 const Pose& camera_from_marker);

}  // namespace fastibl
