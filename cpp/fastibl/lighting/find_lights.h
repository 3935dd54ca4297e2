// The dominant lights of a map.
#pragma once

#include <span>
#include <vector>

#include "fastibl/scene/glossy_chain.h"

namespace fastibl {

struct FoundLight {
  Light light;
  std::vector<TakenTexel> parts;
};

// The lights of the frame before, and its level, of the same size.
struct LightsBefore {
  std::span<const Light> lights;
  const CubeLevel& level;
};

// Face size of the level that refines directions, at most.
inline constexpr int kFinestForLights = 256;

// Finds at most `count` lights: discs of up to 7.5° that hold what is brighter than four times the
// map's mean. level: working_level() of the map; the map itself only refines directions.
// Without a frame before, the lights change continuously with the map. With one, its lights are
// followed: what appeared or went since then belongs to its light at once, while the rest of what a
// light holds grows, fades and gives room to stronger lights by a 25th from map to map. Where fewer
// are asked for than there were, the others fade first.
std::vector<FoundLight> find_lights(const CubeMap& map, const CubeLevel& level,
                                    int count = kMaxLights, const LightsBefore* before = nullptr);

}  // namespace fastibl
