// The shadow of a baked object under a light: the smooth part of the sky by the object's table, the
// brightest parts by their own shadows.
//
// Root mean square error of the ratio against rays over ten lights and three meshes: about 0.0013,
// 0.25 ms for a change of the light at 128²; see bench/shadows/rigid.py.
#pragma once

#include <cstdint>
#include <optional>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/mesh_shadow.h"
#include "fastibl/shadow/near_plane.h"
#include "fastibl/shadow/sky_split.h"

namespace fastibl {

// Keeps, for one object, from one light to the next: where the directions of its light are, and
// what they hide. For another object it begins anew.
class MeshShadowLight {
 public:
  // fine: texels along an edge of a map for a compact light alone, a sun or lamp of a few degrees
  // with at least kCompactShare of the irradiance; 0 for none.
  explicit MeshShadowLight(const SkySplitOptions& options = {}, int fine = 0)
      : options_(options), fine_(fine) {}

  // The shadow of the object where it stands. The directions stay while they suit the light, so
  // that nothing flickers; new ones are faded in over kFadeCasts casts, faster while much of the
  // light moves. Throws std::invalid_argument for a pose that is no motion along the plane.
  // The map's outer image is faded to 1 at its border, so that no edge is seen there.
  // near_lights: of the map. Directions of their light cast shadows from where the lights are, and
  // each light varies over the plane as from its middle. The part of it that is not brighter than
  // the threshold of SkySplitOptions stays distant, and so does light that falls below the horizon
  // of the centre.
  ShadowMap cast(const MeshShadow& shadow, const CubeMap& radiance,
                 const Pose& marker_from_object = {}, const NearLights& near_lights = {});

  static constexpr float kCompactShare = 0.1f;

  int fine() const { return fine_; }
  int directions() const { return int(now_.split.directions().size()); }
  int splits() const { return splits_; }  // how often directions were chosen
  static constexpr int kFadeCasts = 32;

 private:
  struct Set {
    SkySplit split;
    SparseCover inner, outer;  // of the split's directions
    bool drawn = false;
    // For each direction: from where its shadow was drawn, and that shadow; empty where none was.
    std::vector<PlaneProjection> drawn_from;
    std::vector<SparseCover::Source> inner_parts, outer_parts;
    std::vector<int> compact;  // directions in the fine map
    SparseCover fine;
    SkySplit::Weights weights;
    std::vector<glm::vec4> lights;  // weights of the directions, as shares of the light shown
    std::vector<int> near_light;    // for each direction; −1: distant
  };
  using Cover = SparseCover Set::*;
  void update(const CubeMap& radiance);
  std::vector<int> stale_directions(const Set& set, const MeshShadow& shadow) const;
  void draw(const MeshShadow& shadow);
  PlaneGrid fine_grid(const MeshShadow& shadow, const ShadowTriangles& triangles);
  void add_fine(const ShadowMap& rest, ShadowMap& map) const;
  void place_lights(const NearLights& near_lights, const PlaneMotion& motion);
  PlaneProjection projection(const Set& set, std::size_t direction) const;
  // Writes the chosen ones; the others stay.
  void draw_directions(const ShadowTriangles& triangles, const Set& set,
                       std::span<const int> chosen, const PlaneGrid& grid,
                       std::vector<SparseCover::Source>& parts) const;
  enum class Part { all, compact, rest };  // of the directions
  std::vector<glm::vec4> lights_of(const Set& set, Part part, int near_light) const;
  void add_lights(Cover cover, Part part, std::vector<float>& lost) const;
  void add_near(Cover cover, Part part, const PlaneGrid& grid, Image<float>& lost) const;
  void divide_by_light(const PlaneGrid& grid, Image<float>& lost) const;
  // Returns the weights of the cells, and sets those of the directions.
  std::vector<glm::vec4> share_out(const MeshShadow& shadow, bool& no_light);

  SkySplitOptions options_;
  std::uint64_t shadow_ = 0;  // MeshShadow::number() of the object
  Set now_;
  std::optional<Set> before_;  // while the directions are faded
  float fade_ = 1;             // of now_
  CellSums sums_;
  PlaneMotion motion_;
  NearPlane near_;
  // For each near light: its share of the light that shares refer to, and of the light on the
  // plane.
  std::vector<glm::vec3> near_shares_, near_plane_shares_;
  int fine_ = 0;
  PlaneGrid fine_map_;  // its extent is 0 if there is none
  int splits_ = 0;
};

}  // namespace fastibl
