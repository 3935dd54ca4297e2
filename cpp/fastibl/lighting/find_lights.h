// The dominant lights of a map.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/scene/glossy_chain.h"

namespace fastibl {

// A light, and the radiance that it takes from each texel of the level that it was found on.
struct FoundLight {
  Light light;
  struct Part {
    int face, x, y;
    glm::vec3 radiance;
  };
  std::vector<Part> parts;
};

// At most `count` lights: discs of up to 7° that hold what is brighter than four times the map's
// mean. They change continuously with the map. previous: lights of an earlier frame, which are
// followed; they and new ones grow, fade and give room to stronger ones by a 25th from map to map.
// Where fewer are asked for than there were, the others fade first.
// level: working_level() of the map, the map only refines directions.
std::vector<FoundLight> find_lights(const CubeMap& map, const CubeLevel& level,
                                    int count = kMaxLights,
                                    const std::optional<std::vector<Light>>& previous = {});

}  // namespace fastibl
