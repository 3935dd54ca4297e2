// What the map lacks where a camera looks.
#pragma once

#include <optional>

#include "fastibl/capture/map_tiles.h"
#include "fastibl/capture/next_exposure.h"
#include "fastibl/core/pose.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

struct ViewLacks {
  LightLacks lacks;
  std::optional<double> mean;  // radiance of what was seen there before
};
// camera: a perspective one. centre: of the map.
ViewLacks lacks_in_view(const Camera& camera, const Pose& camera_from_marker,
                        const glm::dvec3& centre, const MapTiles& map);

}  // namespace fastibl
