// From a map to the chain in which glossy surfaces are looked up.
#pragma once

#include <memory>
#include <span>

#include "fastibl/lighting/find_lights.h"
#include "fastibl/scene/glossy_chain.h"

namespace fastibl {

// The map's light on 64² faces, whatever its own size: solid-angle means, or copies of larger
// texels.
CubeLevel working_level(const CubeMap& map);

// source: working_level(*map). lights: from find_lights(); they are taken out of the levels as far
// as these are wider than the lights.
std::shared_ptr<GlossyChain> fit_glossy_chain(std::shared_ptr<const CubeMap> map,
                                              const CubeLevel& source,
                                              std::span<const FoundLight> lights);

// What is left of `source` when the lights are taken out whole.
CubeLevel without_lights(const CubeLevel& source, std::span<const TakenTexel> taken);

}  // namespace fastibl
