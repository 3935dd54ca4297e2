// The light that an object keeps from itself, found by rays at every pixel.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "fastibl/scene/bvh.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/sampled_lobe.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/light_pieces.h"
#include "fastibl/shading/near_shares.h"
#include "fastibl/shading/near_tracer.h"
#include "fastibl/shading/rasterize.h"
#include "fastibl/shading/triangle_place.h"

namespace fastibl {

// What is known of a piece of the map before any ray is traced.
enum class PieceState : std::uint8_t { free, hidden, unknown };

// Finds by rays the shares of a map's light that are free. Keeps references.
class TracedLight {
 public:
  static constexpr int kPieces = 1024, kRays = 128;

  // map_from_bvh: rotation. diffuse: whether the shares of the irradiance are wanted.
  TracedLight(const Bvh& bvh, const CubeMap& map, const glm::mat3& map_from_bvh, bool diffuse,
              const std::optional<LobeShape>& lobe);

  // Vectors are in the frame of the bvh, unit. RGB: share of the irradiance, by rays to the pieces
  // of the map. w: share of the light in the lobe, mean of its channels, by kRays along the taps of
  // lobe_taps(), or by the rays to the pieces where few taps meet its light. 1 where there is no
  // light, or where it was not asked for. known: for each piece; empty: nothing is known.
  glm::vec4 shares(glm::vec3 start, glm::vec3 normal, glm::vec3 view,
                   std::span<const PieceState> known = {}) const;
  const LightPieces& pieces() const { return pieces_; }

 private:
  float along_taps(std::span<const LobeTap> taps, glm::vec3 start) const;

  const Bvh& bvh_;
  const CubeMap& map_;
  glm::mat3 map_from_bvh_;
  bool diffuse_;
  std::optional<LobeShape> lobe_;
  LobeHeight height_;
  LightPieces pieces_;
};

// What near lights change of the share of the irradiance that reaches a place, by rays to where
// they are and to where the map has them, less what is interpolated. start: of the rays. own:
// shares of the corners by the map alone. Vectors are in the frame of the bvh.
glm::vec3 traced_near_change(const NearTracer& near_tracer, const Irradiance& irradiance,
                             const glm::mat3& map_from_bvh, const FragmentPlace& at,
                             glm::vec3 start, const std::array<glm::vec3, 3>& own);

// Replaces the fragments' shares where the object hides anything from their triangle's corners.
// Where corners tell of what is between them, no ray is traced for what all three corners and the
// cells around a piece agree on. shares: of the corners, from which the fragments' are
// interpolated. lighting: with its map. near_shares: what near lights change in them, if anything;
// shares of glossy light then stay as they are. Does nothing where the scene has no bvh. eye:
// marker frame.
void trace_shares(const Scene& scene, const Lighting& lighting, glm::vec3 eye,
                  const EntryShares& shares, const NearShares* near_shares,
                  std::span<FragmentBand> bands);

}  // namespace fastibl
