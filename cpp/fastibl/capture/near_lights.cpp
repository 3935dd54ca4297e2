#include "fastibl/capture/near_lights.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kBlur = 0.03;    // radians around a light that it lights in the map
constexpr double kOutline = 1.5;  // of a light's radius: a disc that holds it though it is no disc
constexpr double kPixelBlur = 2;

// Makes the tile's bright texels unseen; true if there are any.
bool forget_bright(int tile, double bright, MapTiles& map) {
  TexelState& state = map.state;
  const std::size_t start = map.geometry.start(tile);
  double* last_seen = nullptr;
  for (int k = 0; k < map.geometry.texels(tile); ++k) {
    const std::size_t at = start + std::size_t(k);
    const double sum =
        double(state.value[0][at]) + double(state.value[1][at]) + double(state.value[2][at]);
    if (!(sum > 3 * bright) || !(state.last_seen.at(tile, k) > kNever)) continue;
    if (!last_seen) last_seen = state.last_seen.texels(tile);
    last_seen[k] = kNever;
    state.bound[at] = 0;
    for (int c = 0; c < 3; ++c) state.variance[c][at] = 0;
  }
  if (last_seen) map.sum(tile);
  return last_seen != nullptr;
}

}  // namespace

std::vector<Disc> discs_of(std::span<const LightPosition> lights, const PosedPicture& posed) {
  const CameraSide& side = posed.side;
  std::vector<Disc> discs;
  const Pose half = posed.half();
  for (const LightPosition& light : lights) {
    glm::dvec3 seen = half * light.position;
    auto pixel = side.lens.project(seen);
    if (pixel && posed.poses.rolling()) {
      seen = posed.poses.at(pixel->y / side.camera.height) * light.position;
      pixel = side.lens.project(seen);
    }
    if (!pixel) continue;
    const double distance = glm::length(seen);
    // Towards the picture's border the same angle covers more pixels.
    const double slope = distance / seen.z, focal = std::max(side.camera.fx, side.camera.fy);
    const double radius = kOutline * light.radius / distance * focal * slope * slope + kPixelBlur;
    discs.push_back({float(pixel->x), float(pixel->y), float(radius * radius)});
  }
  return discs;
}

std::vector<int> forget_light(const LightPosition& light, const std::vector<int>& moved,
                              const PlaceLayout& place, double bright, MapTiles& map) {
  const TileOutlines& outlines = map.geometry.outlines;
  std::vector<int> changed;
  std::vector<glm::dvec3> ghosts;
  for (const LightTracks::Sight& sight : place.tracks().sights(light))
    ghosts.push_back(place.surface().recorded(sight.eye, sight.direction));
  if (ghosts.empty()) return changed;
  const double radius = angular_radius(light, place.centre());
  const std::uint64_t version = new_tile_version();
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    if (!map.above(tile) || !map.was_seen(tile)) continue;
    bool shows = std::find(moved.begin(), moved.end(), tile) != moved.end();
    if (!shows) {
      const glm::dvec3 middle = outlines.middle(tile);
      const double reach = kOutline * radius + kBlur + outlines.reach(tile);
      shows = std::any_of(ghosts.begin(), ghosts.end(), [&](const glm::dvec3& ghost) {
        return glm::dot(ghost, middle) > std::cos(reach);
      });
    }
    if (!shows || !forget_bright(tile, bright, map)) continue;
    map.versions[std::size_t(tile)] = version;
    changed.push_back(tile);
  }
  return changed;
}

}  // namespace fastibl
