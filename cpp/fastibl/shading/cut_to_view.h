// Cuts triangles to what a camera can see of them, so that a triangle with a corner behind the
// camera, or beyond its lens model, keeps its visible part. Also splits triangles where the lens
// bends their edges, since these are drawn straight.
#pragma once

#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/mesh.h"

namespace fastibl {

// The least length, on the plane z = 1, of a line that a perspective camera's lens may bend by 0.2
// pixels, within its picture and a tenth of its size around; infinite where it bends none.
double least_bent(const Camera& camera);
// Keeps it for the last camera.
class LeastBent {
 public:
  double of(const Camera& camera);

 private:
  Camera camera_;
  double least_ = 0;
};
// Whether a triangle has an edge at least as long as that. The mesh must be before the camera.
bool may_be_bent(const Mesh& mesh, const Pose& camera_from_mesh, double least);

struct ViewPlane {
  glm::dvec3 normal;  // inwards
  double shift;
  double at(const glm::dvec3& p) const { return glm::dot(normal, p) + shift; }
};

// The four sides of what a perspective camera's picture shows, and a tenth of its size around, as
// planes through the camera, in its frame.
std::vector<ViewPlane> picture_sides(const Camera& camera);

// The part of space that a perspective camera's picture shows, and somewhat more, as planes in the
// mesh's frame. All points in it lie within the lens model and before the camera, by 0.1 mm or a
// thousandth of the mesh's farthest depth, whichever is less.
class ViewVolume {
 public:
  // least: least_bent(camera)
  ViewVolume(const Mesh& mesh, const Camera& camera, const Pose& camera_from_mesh, double least);
  bool holds(const glm::dvec3& point) const;

  const std::vector<ViewPlane>& planes() const { return planes_; }
  double depth(const glm::dvec3& point) const { return planes_[0].at(point) + nearest_; }
  glm::dvec2 ideal(const glm::dvec3& point) const;  // on the plane z = 1
  // Whether the lens bends the line between two points of the plane z = 1 by 0.2 pixels.
  bool bends(const glm::dvec2& a, const glm::dvec2& b) const;

 private:
  Lens lens_;
  Pose camera_from_mesh_;
  glm::dvec2 focal_;        // pixels
  double nearest_, least_;  // depth, metres; least_bent()
  std::vector<ViewPlane> planes_;
};

struct CutMesh {
  struct Vertex {
    glm::dvec3 position;  // mesh frame
    int triangle;         // the mesh's triangle that it lies on
    glm::vec3 weights;    // between that triangle's corners
    // Interpolates a value that each of the mesh's vertices has.
    template <typename T>
    T mean(const glm::ivec3& corners, const T* values) const {
      return weights.x * values[corners.x] + weights.y * values[corners.y] +
             weights.z * values[corners.z];
    }
  };
  struct Triangle {
    glm::ivec3 corners;  // the mesh's vertices, and the new ones after them
    int whole;           // the triangle of the mesh that it is a part of
  };
  std::vector<Vertex> vertices;     // the new ones
  std::vector<Triangle> triangles;  // those that are drawn instead
  std::vector<char> replaced;       // for each triangle of the mesh
};
// There are no cracks between neighbours: where they are cut or split, their new corners coincide.
CutMesh cut_to_view(const Mesh& mesh, const ViewVolume& volume);

}  // namespace fastibl
