#include "fastibl/capture/probe_level.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr int kColumns = 24, kRows = 18;  // of probes over a picture
constexpr int kLargest = 8;               // pixels along an edge of a probe
constexpr int kStep = 2;                  // pixels between those that are read of a large probe
constexpr float kKnown = 0.15f;           // relative standard deviation of what counts as known

// Where the map shows what an eye sees along a ray: a direction of unit length from its centre;
// std::nullopt for the board, and for what the map does not show.
std::optional<glm::vec3> shown_in(const PlaceLayout& place, const glm::dvec3& eye,
                                  const glm::dvec3& ray) {
  glm::dvec3 direction = ray;
  if (ray.z >= 0) {
    direction = place.surface().recorded(eye, ray);
  } else {
    if (!(eye.z > 0)) return std::nullopt;
    const glm::dvec3 point = eye - eye.z / ray.z * ray;
    if (place.on_page(glm::dvec2(point))) return std::nullopt;
    direction = point - place.centre();
  }
  const double length = glm::length(direction);
  // Else it is the map's centre, or the horizon.
  if (!(length > 0 && std::isfinite(length))) return std::nullopt;
  return glm::vec3(direction / length);
}

// What a picture should show of a direction in the map; std::nullopt where that is not known.
std::optional<LevelProbe> expected_there(const glm::vec3& direction, const MapTiles& map,
                                         const LightChanges& changes, double gain) {
  const TexelState& state = map.state;
  const TexelPlace at_texel = texel_at(direction, map.grid().size);
  const TilePlace there = tile_place(map.grid(), at_texel.face, at_texel.x, at_texel.y);
  const double seen = state.last_seen.at(there.tile, there.texel);
  if (!(seen > kNever)) return std::nullopt;
  const std::size_t at = map.geometry.start(there.tile) + std::size_t(there.texel);
  if (state.bound[at]) return std::nullopt;
  LevelProbe probe{};
  bool lit = true;
  for (int c = 0; c < 3; ++c) {
    const float value = state.value[c][at];
    lit &= value > 0;
    probe.sure &= state.variance[c][at] < kKnown * kKnown * value * value;
    probe.expected[c] = value * float(gain);
  }
  if (!lit) return std::nullopt;
  if (!probe.sure) probe.expected *= changes.since(seen);
  return probe;
}

}  // namespace

std::vector<std::optional<glm::dvec3>> probe_rays(const Camera& camera, const Lens& lens) {
  std::vector<std::optional<glm::dvec3>> rays;
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kColumns; ++column)
      rays.push_back(lens.unproject(
          {(column + 0.5) * camera.width / kColumns, (row + 0.5) * camera.height / kRows}));
  return rays;
}

void probe_level(const PosedPicture& posed, const PlaceLayout& place, const MapTiles& map,
                 const LightChanges& changes, bool unsure, std::vector<LevelProbe>& probes) {
  const CameraSide& side = posed.side;
  const Camera& camera = side.camera;
  const Picture& picture = posed.picture;
  const PixelReader pixels = posed.pixels();
  // As large as a texel in the middle of a face.
  const int texel = int(std::lround(2 * std::min(camera.fx, camera.fy) / map.grid().size));
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
      const auto direction =
          shown_in(place, eye, glm::normalize(marker_from_camera.rotation * *ray));
      if (!direction) continue;
      const double gain = camera.gain * side.vignette(float(cx), float(cy));
      auto probe = expected_there(*direction, map, changes, gain);
      if (!probe || !(probe->sure || unsure)) continue;
      const PixelReader::Block part = pixels.block(x, y, size, size > 2 * kStep ? kStep : 1);
      probe->linear = part.linear, probe->clipped = part.clipped;
      probes.push_back(*probe);
    }
  }
}

}  // namespace fastibl
