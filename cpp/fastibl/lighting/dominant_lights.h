// The dominant lights of a map, and the map without them, for renderers that light with lamps
// beside a map.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/scene/lighting.h"

namespace fastibl {

struct DominantLight : Light {
  std::optional<glm::vec3> position;  // metres, marker frame; none: distant, or not known
  bool operator==(const DominantLight&) const = default;
};

// The lights that the lighting's glossy method shades by themselves; for other methods, those found
// on its map. At most kMaxLights. They have positions where the lighting was fitted with an
// Environment that knows them. The maps that a lighting gives hold these lights as well.
std::vector<DominantLight> dominant_lights(const Lighting& lighting);

// The lighting's map without its dominant lights: the map and the lights together hold every photon
// once. Where a light was, up to about four times the map's mean stays. Of the map's size where
// that is 64, 128, 256, … texels along a face, otherwise of 64.
CubeMap without_lights(const Lighting& lighting);

}  // namespace fastibl
