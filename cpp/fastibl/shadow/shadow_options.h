// How a shadow on the marker plane is cast, and where its map lies.
#pragma once

#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {

struct ShadowOptions {
  ShadowMethod method = ShadowMethod::automatic;  // directions
  ShadowSettings settings = {};
  // Texels along an edge. 0: the method's own number, 64 for caps, 128 for directions.
  int resolution = 0;
  float extent = 0;  // half the edge in metres; 0 = 3 × the spheres' half width or half height
  std::optional<glm::vec2> centre = {};  // metres; by default the middle of the spheres
  // Adds a coarse map around the first one, with the methods that have it. It reaches so far that
  // what is left out changes no ratio by more than 1/510, but at most 8 times as far. Without it,
  // the ratio fades to 1 within the first map.
  bool outer = true;
  bool operator==(const ShadowOptions&) const = default;
};

inline ShadowMethod resolved(ShadowMethod method) {
  return method == ShadowMethod::automatic ? ShadowMethod::directions : method;
}

// Throws std::invalid_argument for a resolution that is neither 0 nor from 2 to 8192, and for an
// invalid extent or centre.
void check_options(const ShadowOptions& options);

// Sets the centre and extent of the map of these spheres; ±1 m around 0 when there are none.
void place_map(const SphereSet& spheres, const ShadowOptions& options, ShadowMap& map);

}  // namespace fastibl
