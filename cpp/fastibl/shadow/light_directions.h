// A few directions that stand for all light of the sky on the plane z = 0: the sky is cut into
// parts of the same weight, and each is replaced by its mean direction. One set for all channels,
// with a weight for each: luminance alone would starve blue.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/methods.h"
#include "fastibl/shadow/sky_energy.h"

namespace fastibl {

struct LightDirection {
  glm::vec3 direction;  // towards the light, unit length, z > 0, marker frame
  glm::vec3 share;      // of the plane's irradiance, by channel; a lit channel's sum to 1
  bool operator==(const LightDirection&) const = default;
};

// Cube faces of this many texels at most are read: finer ones changed the ratio by less than the
// directions do.
inline constexpr int kDirectionLevel = 64;

// `count` parts of the same weight (the sum over channels of the share of the plane's irradiance),
// by recursive splitting along the side that spans the larger angle. Fewer where there is less
// light; none without light. Deterministic.
std::vector<SkyRect> split_sky(const SkyEnergy& sky, int count);

// Their mean directions and shares.
std::vector<LightDirection> light_directions(const SkyEnergy& sky, std::span<const SkyRect> parts);
std::vector<LightDirection> light_directions(const CubeMap& radiance, int count = 256);

// Shares as whole numbers: in every lit channel they sum to exactly 2^30, so that all light
// together is exactly 1, and none is 0.
inline constexpr int kWholeShare = 1 << 30;
std::vector<glm::ivec4> whole_shares(std::span<const LightDirection> directions);
// What is left when that much is lost.
inline float remaining(std::int32_t lost) { return 1 - float(lost) * (1.0f / kWholeShare); }

}  // namespace fastibl
