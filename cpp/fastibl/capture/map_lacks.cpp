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
  const double texel = 4.0 / grid_.size / grid_.size * camera.fx * camera.fy;
  for (int tile = 0; tile < grid_.count(); ++tile) {
    const glm::dvec3 middle = outlines_.middle(tile);
    glm::dvec3 seen = camera_from_marker.rotation * middle;
    if (!unseen_.above(tile)) {  // a point of the plane
      if (!(middle.z < 0)) continue;
      seen = camera_from_marker * (options_.centre - options_.centre.z / middle.z * middle);
    }
    const auto pixel = lens.project(seen);
    if (!pixel || !camera.inside(*pixel)) continue;
    const double slope = glm::length(seen) / seen.z;
    const double pixels = texel * slope * slope * slope;
    const FaceRect r = tile_rect(grid_, tile);
    const std::size_t start = std::size_t(tile) * std::size_t(grid_.stride());
    const float* angles = angles_of(tile);
    const double vignette = camera.vignette(*pixel);
    for (int k = 0; k < r.texels(); ++k) {
      const std::size_t at = start + std::size_t(k);
      const double angle = double(angles[k]);
      if (!(state_.last_seen.at(tile, k) > kNever)) {
        lacks.add_unseen(angle, pixels);
        continue;
      }
      float most = 0;
      double sum = 0, variance = 0;
      for (int c = 0; c < 3; ++c) {
        most = std::max(most, state_.value[c][at]);
        sum += double(state_.value[c][at]), variance += double(state_.variance[c][at]);
      }
      flux += sum / 3 * angle, angle_seen += angle;
      const double brightest = double(most) * vignette;  // clips first
      if (state_.bound[at])
        lacks.add_bound(brightest, angle, pixels);
      else
        lacks.add_known(brightest, angle, std::sqrt(variance) / std::max(sum, 1e-9), pixels);
    }
  }
  const double mean = angle_seen > 0 ? flux / angle_seen : mean_radiance();
  // An empty map says nothing of the light. What clips at the longest exposure asks for a shorter
  // one next.
  return mean > 0 ? fastibl::next_exposure(lacks, mean, range, camera.gain) : range.longest;
}

}  // namespace fastibl
