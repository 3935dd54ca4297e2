// Finds which surface a camera sees in each pixel: a z-buffer with four samples a pixel.
#pragma once

#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/cut_to_view.h"
#include "fastibl/shading/interpolate.h"
#include "fastibl/shading/sample_cells.h"

namespace fastibl {

// The part of a pixel that one triangle covers; several may share a pixel. Its normal is of unit
// length, on the side of the triangle that faces the camera.
struct Fragment : Varying {
  int x = 0, y = 0;
  int triangle = 0;              // of the scene's mesh
  float coverage = 0;            // in quarters
  glm::vec2 uv_dx{0}, uv_dy{0};  // steps of uv to the pixels to the right and below
  glm::vec3 color{1};            // of Mesh::colors
};

// The part of a pixel that a real object covers in front of the virtual one.
struct HoldoutFragment {
  int x, y;
  float coverage;   // in quarters
  glm::vec3 ratio;  // share of its light that is left
};

// The fragments of some rows of the picture, in order of rows, then columns.
struct FragmentBand {
  std::vector<Fragment> object;
  std::vector<HoldoutFragment> holdouts;
  double found = 0;  // fragments of the object before any were merged
};

// A triangle whose normals within a pixel differ by half of the width of the material's lobe, or by
// more where little of its light is glossy, is shaded at each of its samples. Shaded at their
// middle alone, a rim of a pixel or two would miss what it mirrors, and flicker. Returns the cosine
// of that angle; -2 where it is as wide as for matte light.
float curved_cosine(const Material& material);

// Makes parts of one pixel whose normals hardly differ, for this material, one; none with textures.
// For parts that had to be apart until now.
void merge_alike(const Material& material, std::span<FragmentBand> bands);

// Keeps its memory from picture to picture.
class Rasterizer {
 public:
  Rasterizer();
  ~Rasterizer();

  // Bands of rows from the top, none where nothing is seen; valid until the next call. Vertices go
  // through the full lens model; edges between them are straight, and split where the lens bends
  // them. Triangles with a corner behind the camera or beyond the lens model are cut
  // (cut_to_view.h). light_shares: of each vertex, and perhaps of their backs after them; empty:
  // P_V of the scene, and all of the glossy light. holdout_ratios: of each vertex of the holdouts;
  // empty: 1. merge: whether to do what merge_alike() does.
  std::span<FragmentBand> rasterize(const Scene& scene, const Camera& camera,
                                    const Pose& camera_from_marker,
                                    std::span<const glm::vec4> light_shares = {},
                                    std::span<const glm::vec4> holdout_ratios = {},
                                    bool merge = false);

 private:
  struct Geometry;  // of one picture
  struct Work;      // of one thread
  void project(const Geometry& geometry, const Pose& camera_from_marker);
  void cut(Geometry& geometry, const Pose& camera_from_marker);
  void set_window(const Camera& camera);
  void set_varyings(const Geometry& geometry, std::span<const glm::vec4> light_shares);
  void sort_triangles(const Geometry& geometry, int bands);
  // Whether the normals at a triangle's samples in a pixel are too far apart.
  bool is_curved(const Geometry& geometry, const DrawnTriangle& triangle, const TrianglePart& part,
                 const SampleCell& cell) const;
  void resolve(const Geometry& geometry, const SampleWindow& window, Work& work,
               FragmentBand& band) const;
  void add(const Geometry& geometry, const TrianglePart& part, Work& work,
           FragmentBand& band) const;
  void flush(const Geometry& geometry, Work& work, FragmentBand& band) const;
  std::unique_ptr<Work> borrow();
  void give_back(std::unique_ptr<Work> work);

  // Of the object's vertices, the holdouts' vertices, and the new ones where either is cut.
  std::vector<PictureCorner> corners_;
  std::vector<Varying> varyings_;  // of the object's vertices; if it is cut, of all corners
  LeastBent least_bent_;
  CutMesh cut_;  // numbered as corners_ and Geometry's triangles
  std::vector<glm::vec4> cut_back_shares_, cut_holdout_ratios_;  // including those of new corners
  std::vector<glm::vec3> cut_colors_;                            // likewise
  std::vector<std::vector<int>> triangles_of_;                   // by band
  std::vector<std::uint8_t> bends_;  // for each of the object's triangles: whether it may be curved
  std::vector<FragmentBand> found_;
  std::vector<std::unique_ptr<Work>> idle_;
  std::mutex idle_mutex_;
  int left_ = 0, right_ = -1, top_ = 0, bottom_ = -1;  // of all vertices, within the picture
};

}  // namespace fastibl
