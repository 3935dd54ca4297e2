#include "fastibl/capture/map_lacks.h"

#include <algorithm>
#include <cmath>

namespace fastibl {

ViewLacks lacks_in_view(const Camera& camera, const Pose& camera_from_marker,
                        const glm::dvec3& centre, const MapTiles& map) {
  const Lens lens(camera);
  ViewLacks view;
  double flux = 0, angle_seen = 0;
  const double texel = 4.0 / map.grid().size / map.grid().size * camera.fx * camera.fy;
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    const glm::dvec3 middle = map.geometry.outlines.middle(tile);
    glm::dvec3 seen = camera_from_marker.rotation * middle;
    if (!map.above(tile)) {  // a point of the plane
      if (!(middle.z < 0)) continue;
      seen = camera_from_marker * (centre - centre.z / middle.z * middle);
    }
    const auto pixel = lens.project(seen);
    if (!pixel || !camera.inside(*pixel)) continue;
    const double slope = glm::length(seen) / seen.z;
    const double pixels = texel * slope * slope * slope;
    const std::size_t start = map.geometry.start(tile);
    const float* angles = map.geometry.angles(tile);
    const double vignette = camera.vignette(*pixel);
    for (int k = 0; k < map.geometry.texels(tile); ++k) {
      const std::size_t at = start + std::size_t(k);
      const double angle = double(angles[k]);
      if (!(map.state.last_seen.at(tile, k) > kNever)) {
        view.lacks.add_unseen(angle, pixels);
        continue;
      }
      float most = 0;
      double sum = 0, variance = 0;
      for (int c = 0; c < 3; ++c) {
        most = std::max(most, map.state.value[c][at]);
        sum += double(map.state.value[c][at]), variance += double(map.state.variance[c][at]);
      }
      flux += sum / 3 * angle, angle_seen += angle;
      const double brightest = double(most) * vignette;  // clips first
      if (map.state.bound[at])
        view.lacks.add_bound(brightest, angle, pixels);
      else
        view.lacks.add_known(brightest, angle, std::sqrt(variance) / std::max(sum, 1e-9), pixels);
    }
  }
  if (angle_seen > 0) view.mean = flux / angle_seen;
  return view;
}

}  // namespace fastibl
