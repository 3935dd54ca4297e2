// What the map lacks where a camera looks.
#include <algorithm>
#include <cmath>

#include "fastibl/capture/capture.h"
#include "fastibl/core/check.h"

namespace fastibl {

double Capture::next_exposure(const Camera& camera, const Pose& camera_from_marker,
                              const ExposureRange& range) const {
  check(camera.model == CameraModel::perspective,
        "the next exposure is chosen for perspective cameras only");
  camera.validate();
  check(range.shortest > 0 && range.longest >= range.shortest && std::isfinite(range.longest),
        "exposures must range from a positive one to a longer one, got ", range.shortest, " to ",
        range.longest);
  const Lens lens(camera);
  LightLacks lacks;
  double flux = 0, angle_seen = 0;
  const double texel = 4.0 / map_.grid().size / map_.grid().size * camera.fx * camera.fy;
  for (int tile = 0; tile < map_.grid().count(); ++tile) {
    const glm::dvec3 middle = map_.geometry.outlines.middle(tile);
    glm::dvec3 seen = camera_from_marker.rotation * middle;
    if (!map_.above(tile)) {  // a point of the plane
      if (!(middle.z < 0)) continue;
      seen = camera_from_marker * (options_.centre - options_.centre.z / middle.z * middle);
    }
    const auto pixel = lens.project(seen);
    if (!pixel || !camera.inside(*pixel)) continue;
    const double slope = glm::length(seen) / seen.z;
    const double pixels = texel * slope * slope * slope;
    const FaceRect r = tile_rect(map_.grid(), tile);
    const std::size_t start = map_.geometry.start(tile);
    const float* angles = map_.geometry.angles(tile);
    const double vignette = camera.vignette(*pixel);
    for (int k = 0; k < r.texels(); ++k) {
      const std::size_t at = start + std::size_t(k);
      const double angle = double(angles[k]);
      if (!(map_.state.last_seen.at(tile, k) > kNever)) {
        lacks.add_unseen(angle, pixels);
        continue;
      }
      float most = 0;
      double sum = 0, variance = 0;
      for (int c = 0; c < 3; ++c) {
        most = std::max(most, map_.state.value[c][at]);
        sum += double(map_.state.value[c][at]), variance += double(map_.state.variance[c][at]);
      }
      flux += sum / 3 * angle, angle_seen += angle;
      const double brightest = double(most) * vignette;  // clips first
      if (map_.state.bound[at])
        lacks.add_bound(brightest, angle, pixels);
      else
        lacks.add_known(brightest, angle, std::sqrt(variance) / std::max(sum, 1e-9), pixels);
    }
  }
  const double mean = angle_seen > 0 ? flux / angle_seen : fills_.mean_radiance(map_);
  // An empty map says nothing of the light. What clips at the longest exposure asks for a shorter
  // one next.
  return mean > 0 ? fastibl::next_exposure(lacks, mean, range, camera.gain) : range.longest;
}

}  // namespace fastibl
