// What a rigid object hides of the sky from the marker plane, worked out once from its triangles.
// Its shadow under any light is then a sum of products, see shadow/mesh_shadow_light.h.
#pragma once

#include <cstdint>
#include <optional>

#include "fastibl/core/plane_motion.h"
#include "fastibl/core/progress.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/shadow/plane_bits.h"
#include "fastibl/shadow/sky_cells.h"
#include "fastibl/shadow/sparse_cover.h"
#include "fastibl/shadow/triangle_bits.h"

namespace fastibl {

struct MeshShadowOptions {
  int resolution = 128;  // texels along an edge of the map, and of a coarse one around it
  float extent = 0;      // half the map's edge in metres; 0: 1.5 times the object's largest extent
  int rings = 16;        // rings of sky cells: 4 rings² cells
  int samples = 9;       // directions in each cell, 1 to 63
  bool operator==(const MeshShadowOptions&) const = default;
};

class MeshShadow {
 public:
  // Half the edge of the coarse map, × extent. A sun 6° above the horizon casts a shadow of that
  // length; it fades over the outer tenth.
  static constexpr float kOuter = 6;

  // The covers of the cells on both maps.
  struct Tables {
    SparseCover inner, outer;
    bool operator==(const Tables&) const = default;
  };
  using Progress = fastibl::Progress;

  // mesh: as it stands on the plane z = 0; what is below casts no shadow. Empty if `progress` ended
  // the work. Throws std::invalid_argument as Mesh::validate, and for options out of range.
  static std::optional<MeshShadow> bake(const Mesh& mesh, const MeshShadowOptions& options = {},
                                        const Progress& progress = {});
  // Uses the tables of an earlier bake of the same mesh with the same options; throws
  // std::invalid_argument for tables of another size.
  MeshShadow(const Mesh& mesh, const MeshShadowOptions& options, Tables tables);

  const MeshShadowOptions& options() const { return options_; }
  const PlaneGrid& inner() const { return inner_; }  // in the object's frame
  const PlaneGrid& outer() const { return outer_; }  // the same, kOuter times as large
  const SkyCells& cells() const { return cells_; }
  const Tables& tables() const { return tables_; }
  const ShadowTriangles& triangles() const { return triangles_; }
  // For the outer map: the same triangles, or fewer where its texels cannot tell them apart.
  const ShadowTriangles& outer_triangles() const {
    return outer_triangles_.empty() ? triangles_ : outer_triangles_;
  }
  // The same for copies, and for no other bake.
  std::uint64_t number() const { return number_; }
  std::size_t bytes() const { return tables_.inner.bytes() + tables_.outer.bytes(); }

  // How the object was moved along the plane; nothing where it was tilted or lifted, which needs
  // another bake.
  std::optional<PlaneMotion> motion(const Pose& marker_from_object) const {
    return motion_along_plane(marker_from_object, inner_.centre, size_);
  }

 private:
  MeshShadow(const Mesh& mesh, const MeshShadowOptions& options);
  MeshShadowOptions options_;
  PlaneGrid inner_, outer_;
  SkyCells cells_;
  ShadowTriangles triangles_, outer_triangles_;  // empty: no others
  Tables tables_;
  float size_ = 0;  // largest extent
  std::uint64_t number_ = 0;
};

}  // namespace fastibl
