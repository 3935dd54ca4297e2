// A few directions that stand for all light of the sky on the plane z = 0: the sky is cut into
// parts of the same weight, and each is replaced by its mean direction. There is one set for all
// channels, with a weight for each: by luminance alone, blue would get too few.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/shadow/sky_energy.h"

namespace fastibl {

struct LightDirection {
  glm::vec3 direction;  // towards the light, unit length, z > 0, marker frame
  glm::vec3 share;      // of the plane's irradiance, by channel; those of a lit channel sum to 1
  bool operator==(const LightDirection&) const = default;
};

// A part of the sky and the direction that stands for it.
struct SkyPart {
  SkyRect rect;
  glm::vec3 direction;
  bool operator==(const SkyPart&) const = default;
};

// `count` parts of about the same weight, by recursive splitting along the side that spans the
// larger angle; up to three times as many where the channels get their light from different places.
// Empty without light. Deterministic.
std::vector<SkyPart> split_sky(const SkyEnergy& sky, int count);
// The weight above which a texel counts as bright when the sky is cut into `count` parts: that of
// several parts.
inline double brightest_texel(int count) { return 2.0 / count; }

// The directions of the parts, with their shares under any light.
std::vector<LightDirection> light_directions(const SkyEnergy& sky, std::span<const SkyPart> parts);
std::vector<LightDirection> light_directions(const CubeMap& radiance, int count = 256);

// Shares as whole numbers: in every lit channel they sum to exactly 2^30, so that all light
// together is exactly 1, and no light is exactly 0.
inline constexpr int kWholeShare = 1 << 30;
std::vector<glm::ivec4> whole_shares(std::span<const LightDirection> directions);
// The share that is left when this much is lost.
inline float remaining(std::int32_t lost) { return 1 - float(lost) * (1.0f / kWholeShare); }

}  // namespace fastibl
