// The captured map as an inset of a picture.
#pragma once

#include <cstdint>

#include "fastibl/core/image.h"
#include "fastibl/scene/environment.h"

namespace fastibl::demo {

// Draws the map equirectangularly (z on top, +y in the middle) into the lower right corner of an
// RGB picture. What was never seen is dimmed and striped. exposure: radiance that is drawn white is
// 1 / exposure.
void draw_map(Image<std::uint8_t>& picture, const Environment& environment, double exposure);

}  // namespace fastibl::demo
