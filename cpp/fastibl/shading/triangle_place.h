// Finds which triangle a pixel is on, and where.
#pragma once

#include <array>
#include <span>

#include "fastibl/scene/scene.h"
#include "fastibl/shading/rasterize.h"

namespace fastibl {

// A place on a triangle, all in one frame.
struct TrianglePlace {
  struct Corner {
    glm::vec3 position, normal;  // unit, on the visible side
    glm::vec3 origin;            // start of its rays, without offset
  };
  std::array<Corner, 3> corners;
  glm::vec3 weights;           // of the corners
  glm::vec3 position, normal;  // unit, on the visible side
};
// Where rays start: on the round surface that the normals describe, not on the flat triangles,
// which their own neighbours hide: Hanika 2021, Hacking the Shadow Terminator. The corners' own
// origins are on it.
glm::vec3 ray_start(const TrianglePlace& place, float offset);

// The place of a fragment, in the mesh's frame.
struct FragmentPlace {
  std::array<std::size_t, 3> entries;  // of the scene's directions, by corner
  TrianglePlace place;
};
// Shares that the map alone leaves to entries, and those of all light, which near lights and the
// plane change; either may be without them.
struct EntryShares {
  std::span<const glm::vec4> own, all;

  // Of the irradiance, between corners: by the map alone, and what the others change.
  glm::vec3 of_map(const FragmentPlace& at) const { return sum(own, at); }
  glm::vec3 of_others(const FragmentPlace& at) const {
    return all.size() == own.size() ? sum(all, at) - sum(own, at) : glm::vec3(0);
  }
  std::array<glm::vec3, 3> of_map_at(const std::array<std::size_t, 3>& entries) const {
    return {own[entries[0]], own[entries[1]], own[entries[2]]};
  }

 private:
  static glm::vec3 sum(std::span<const glm::vec4> shares, const FragmentPlace& at) {
    glm::vec3 sum(0);
    for (std::size_t k = 0; k < 3; ++k)
      sum += at.place.weights[int(k)] * glm::vec3(shares[at.entries[k]]);
    return sum;
  }
};

// For scenes that have directions.
class FragmentPlaces {
 public:
  explicit FragmentPlaces(const Scene& scene);
  FragmentPlace of(const Fragment& fragment) const;
  std::array<std::size_t, 3> entries(const Fragment& fragment) const;  // those alone
  // To the eye, unit. eye: marker frame.
  glm::vec3 view(const Fragment& fragment, glm::vec3 eye) const {
    return glm::normalize(mesh_from_map_ * (eye - fragment.position));
  }

 private:
  bool from_behind(const Fragment& fragment) const;

  const Scene& scene_;
  glm::mat3 mesh_from_map_;
  glm::vec3 shift_;
};

}  // namespace fastibl
