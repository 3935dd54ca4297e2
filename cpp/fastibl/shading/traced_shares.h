// The light that an object keeps from itself, by rays at every pixel.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "fastibl/scene/bvh.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/sampled_lobe.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/light_pieces.h"
#include "fastibl/shading/rasterize.h"
#include "fastibl/shading/triangle_place.h"

namespace fastibl {

// What is known of a piece of the map without asking.
enum class PieceState : std::uint8_t { free, hidden, unknown };

// Shares of the light of a map that are free, by rays. Keeps references.
class TracedLight {
 public:
  static constexpr int kPieces = 1024, kRays = 128;

  // map_from_bvh: rotation. diffuse: whether the shares of the irradiance are asked for.
  TracedLight(const Bvh& bvh, const CubeMap& map, const glm::mat3& map_from_bvh, bool diffuse,
              const std::optional<LobeShape>& lobe);

  // In the frame of the bvh, unit. RGB: of the irradiance, by rays to the pieces of the map. w: of
  // the light in the lobe, mean of its channels, by kRays along the taps of lobe_taps(), or, where
  // few of these meet its light, by the former. 1 where there is no light, or it was not asked
  // for. known: of each piece; none: nothing.
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

// In place of the fragments' shares, where the object hides anything from their triangle's
// corners; what all three corners and the cells around a piece agree on is not asked for where
// corners tell of what is between them. self_shares: of the corners by the map alone, which the
// fragments' are interpolated from, but for near lights and light from the plane. Nothing where the
// scene has no bvh. eye: marker frame.
void trace_shares(const Scene& scene, const CubeMap& map, glm::vec3 eye,
                  std::span<const glm::vec4> self_shares, std::span<FragmentBand> bands);

}  // namespace fastibl
