// Samples of an object and of the plane around it, with what rays from there tell of the sky.
// Methods are compared at these samples before one is chosen.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "fastibl/core/progress.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

// Samples of the object as it stood when they were made; where seen from all round, without its
// turn about z. An object that is tilted or lifted later is judged as if it still stood so. The
// frame is the marker's, moved along the plane to where the object stands.
class SceneSamples {
 public:
  static constexpr int kLevelSize = 32;  // face edge of the level whose texels are the directions
  static constexpr int kViews = 8, kViewSamples = 120, kPlaneSamples = 400;
  static constexpr int kPicturePixels = 600, kPicturePlaneSamples = 1600;  // of one picture
  static constexpr int kClose = 10;  // ratio of places on the plane without rays to those with
  static constexpr int kViewsFromBelow = 4, kSamplesFromBelow = 60;
  static constexpr float kElevation = 0.65f;  // of the views all round, radians

  struct Surface {
    int corners[3];  // in `vertices`: of the visible side
    glm::vec3 weights;
    glm::vec3 position, normal;  // where the object stands; unit, on the visible side
    glm::vec3 start;             // of its rays
    glm::vec3 to_eye;            // unit
    int view;                    // in `eyes`
    glm::vec4 tangent;           // see Fragment
    glm::vec2 uv;
    glm::vec3 color;  // of Mesh::colors
    int place = 0;    // which of its pixel's samples it is
  };
  // What views see of the object, with each pixel equally often. The first `seen` samples are of
  // the views that pictures are taken from; the rest are of views from below, which tell what the
  // plane sees. The eyes all round and from below are so far away that their directions are the
  // same everywhere.
  std::vector<Surface> surface;
  std::size_t seen = 0;
  // Where each pixel's samples begin among the seen ones, and their end. A picture's pixel is drawn
  // by four samples, of which those are kept that meet the object. From all round, each sample is a
  // pixel of its own, which it fills.
  std::vector<std::size_t> pixels;
  float part = 1;  // share of its pixel that a sample fills
  std::vector<glm::vec3> eyes;
  std::size_t picture_count = 0;  // of `eyes`, the first ones; the rest are from below
  // Directions of the texel centres of a level of kLevelSize, face by face and row by row.
  std::vector<glm::vec3> directions;
  std::vector<float> solid_angles;
  std::vector<std::uint8_t>
      free;  // [sample][direction]: above the tangent plane, and nothing there

  std::vector<glm::vec2> plane;  // places on the plane that a view sees
  // Where the directions that the object hides from each place begin in `hidden`, and their end.
  std::vector<std::uint32_t> plane_first;
  std::vector<std::uint16_t> hidden;
  std::shared_ptr<const Bvh> bvh;  // of the object as it stands
  glm::vec3 centre{0};             // of the sphere around it
  float radius = 0;
  float above = 0;  // height at which rays from the plane start, metres
  // Areas in pictures, of the object and of what each place on the plane stands for: in m² as a
  // view from afar has them, in the mean over all views, or as shares of one picture.
  double object_area = 0;
  std::vector<double> plane_areas;
  // Many more places, without rays: there shadows are compared with each other.
  std::vector<glm::vec2> close_plane;
  std::vector<double> close_areas;

  // For the vertices that samples lie between, on the visible side.
  VertexVisibility visibility;
  std::vector<glm::vec3> vertices, normals;  // mesh frame, of that side
  std::vector<glm::vec3> origins;            // of rays, likewise
  std::vector<float> openness;               // P_V
  glm::mat3 turned{1};  // the object's rotation; all round, without its turn about z
  double lifted = 0;    // metres

  std::size_t direction_count() const { return directions.size(); }
  // Which of `directions` is the middle of the texel that another one meets.
  static std::size_t direction_at(glm::vec3 direction) {
    const TexelPlace at = texel_at(direction, kLevelSize);
    return std::size_t((at.face * kLevelSize + at.y) * kLevelSize + at.x);
  }
  bool empty() const { return seen == 0; }
};

// From the samples' frame to the marker's: the object's middle is then where it is now, whether or
// not it was turned.
glm::vec3 shift_of(const Scene& scene, const SceneSamples& samples);

// Samples as seen from all round. Null where the directions that the object blocks were not worked
// out, or where no view sees it. Takes some 4 million rays. Throws WorkEnded.
std::shared_ptr<const SceneSamples> sample_scene(const Scene& scene, const Progress& progress = {});
// Samples as one picture shows them. Null also where it shows nothing of the object.
std::shared_ptr<const SceneSamples> sample_scene(const Scene& scene, const Camera& camera,
                                                 const Pose& camera_from_marker);

}  // namespace fastibl
