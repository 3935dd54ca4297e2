// The chain of round lobes by exact sums at a finer resolution, for environments that stay.
#pragma once

#include <memory>

#include "fastibl/scene/glossy_chain.h"

namespace fastibl {

// The lobes of GlossyChain's levels, each within 0.2 % of the sum over the map and four texels to a
// standard deviation; no light is taken out. 20 to 100 ms, against 1 ms of fit_glossy_chain().
std::shared_ptr<GlossyChain> fit_prefiltered_chain(std::shared_ptr<const CubeMap> map);

}  // namespace fastibl
