#include "fastibl/capture/probe_level.h"

#include <algorithm>
#include <cmath>

#include "fastibl/capture/capture.h"

namespace fastibl {
namespace {

constexpr int kColumns = 24, kRows = 18;  // of probes over a picture
constexpr int kLargest = 8;               // pixels along an edge of a probe
constexpr int kStep = 2;                  // pixels between those that are read of a large probe
constexpr float kKnown = 0.15f;           // relative standard deviation of what counts as known

}  // namespace

std::vector<std::optional<glm::dvec3>> probe_rays(const Camera& camera, const Lens& lens) {
  std::vector<std::optional<glm::dvec3>> rays;
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kColumns; ++column)
      rays.push_back(lens.unproject(
          {(column + 0.5) * camera.width / kColumns, (row + 0.5) * camera.height / kRows}));
  return rays;
}

void Capture::probe_level(const PosedPicture& posed, bool unsure,
                          std::vector<LevelProbe>& probes) const {
  const CameraSide& side = posed.side;
  const Camera& camera = side.camera;
  const Picture& picture = posed.picture;
  const PixelReader pixels = posed.pixels();
  // As large as a texel in the middle of a face.
  const int texel = int(std::lround(2 * std::min(camera.fx, camera.fy) / map_.grid().size));
  const int size = std::min({std::clamp(texel, 1, kLargest), picture.width, picture.height});
  for (int row = 0; row < kRows; ++row) {
    const double cy = (row + 0.5) * picture.height / kRows;
    const Pose marker_from_camera = posed.poses.at(cy / picture.height).inverse();
    const glm::dvec3& eye = marker_from_camera.translation;
    for (int column = 0; column < kColumns; ++column) {
      const double cx = (column + 0.5) * picture.width / kColumns;
      const int x = std::clamp(int(cx) - size / 2, 0, picture.width - size);
      const int y = std::clamp(int(cy) - size / 2, 0, picture.height - size);
      if (!posed.mask.empty() && !*posed.mask.pixel(int(cx), int(cy))) continue;
      const std::optional<glm::dvec3>& ray = side.probe_rays[std::size_t(row * kColumns + column)];
      if (!ray) continue;
      glm::dvec3 direction = glm::normalize(marker_from_camera.rotation * *ray);
      if (direction.z >= 0) {
        direction = surface().recorded(eye, direction);
      } else {
        if (!(eye.z > 0)) continue;
        const glm::dvec3 point = eye - eye.z / direction.z * direction;
        if (place_.on_page(glm::dvec2(point))) continue;
        direction = point - options_.centre;
      }
      const double length = glm::length(direction);
      if (!(length > 0 && std::isfinite(length))) continue;  // the map's centre, or the horizon
      const TexelPlace texel_there = texel_at(glm::vec3(direction / length), map_.grid().size);
      const TilePlace there =
          tile_place(map_.grid(), texel_there.face, texel_there.x, texel_there.y);
      const double seen = map_.state.last_seen.at(there.tile, there.texel);
      if (!(seen > kNever)) continue;
      const std::size_t at =
          std::size_t(there.tile) * std::size_t(map_.grid().stride()) + std::size_t(there.texel);
      if (map_.state.bound[at]) continue;
      LevelProbe probe{};
      bool lit = true;
      for (int c = 0; c < 3; ++c) {
        const float value = map_.state.value[c][at];
        lit &= value > 0;
        probe.sure &= map_.state.variance[c][at] < kKnown * kKnown * value * value;
        probe.expected[c] = value * float(camera.gain * side.vignette(float(cx), float(cy)));
      }
      if (!lit || !(probe.sure || unsure)) continue;
      if (!probe.sure) probe.expected *= changes_.since(seen);
      const PixelReader::Block part = pixels.block(x, y, size, size > 2 * kStep ? kStep : 1);
      probe.linear = part.linear, probe.clipped = part.clipped;
      probes.push_back(probe);
    }
  }
}

}  // namespace fastibl
