#include "fastibl/capture/near_lights.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <utility>

#include "fastibl/capture/texel_view.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {
namespace {

constexpr double kBlur = 0.03;    // radians around a light that it lights in the map
constexpr double kOutline = 1.5;  // of a light's radius: a disc that holds it though it is no disc
constexpr double kPixelBlur = 2;
constexpr double kFarthest = 0.5;  // radians that a light's texels are moved
constexpr float kMoved = 0.3f;     // relative standard deviation of what was moved

// What the map knew of a light's texel.
struct LightTexel {
  std::size_t at;  // in arrays by tile
  glm::dvec3 direction;
  float value[3], variance[3];
  std::uint8_t bound;
  double seen;

  float sum() const { return value[0] + value[1] + value[2]; }
};

template <typename See>
void each_texel(int tile, const MapTiles& map, See&& see) {
  const int size = map.grid().size;
  const FaceRect r = tile_rect(map.grid(), tile);
  int k = 0;
  for (int y = r.y0; y < r.y1; ++y)
    for (int x = r.x0; x < r.x1; ++x, ++k)
      see(k, glm::normalize(glm::dvec3(texel_direction(r.face, x, y, size))));
}

// Makes the tile's bright texels unseen; true if there are any.
bool forget_bright(int tile, double bright, MapTiles& map, std::vector<LightTexel>& forgotten) {
  TexelState& state = map.state;
  const std::size_t start = map.geometry.start(tile), before = forgotten.size();
  each_texel(tile, map, [&](int k, const glm::dvec3& direction) {
    const std::size_t at = start + std::size_t(k);
    LightTexel t{at, direction, {}, {}, state.bound[at], state.last_seen.at(tile, k)};
    for (int c = 0; c < 3; ++c)
      t.value[c] = state.value[c][at], t.variance[c] = state.variance[c][at];
    if (!(double(t.sum()) > 3 * bright) || !(t.seen > kNever)) return;
    state.last_seen.texels(tile)[k] = kNever;
    state.bound[at] = 0;
    for (int c = 0; c < 3; ++c) state.variance[c][at] = 0;
    forgotten.push_back(t);
  });
  if (forgotten.size() > before) map.sum(tile);
  return forgotten.size() > before;
}

// Of a light's forgotten texels, those that were seen last: older ones may be of other places.
void keep_last_seen(std::vector<LightTexel>& texels) {
  double last = kNever;
  for (const LightTexel& t : texels) last = std::max(last, t.seen);
  std::erase_if(texels, [&](const LightTexel& t) { return t.seen < last; });
}

glm::dvec3 middle(const std::vector<LightTexel>& texels) {
  glm::dvec3 sum(0);
  for (const LightTexel& t : texels) sum += double(t.sum()) * t.direction;
  return glm::normalize(sum);
}

// Shows a light's texels where it is; adds the tiles that change.
void show(std::vector<LightTexel> texels, const glm::dvec3& towards, MapTiles& map,
          std::vector<int>& changed) {
  keep_last_seen(texels);
  const glm::dvec3 from = middle(texels);
  if (!(glm::dot(from, towards) > std::cos(kFarthest))) return;
  const glm::dmat3 back = rotation_between(towards, from);
  std::unordered_map<std::size_t, const LightTexel*> by_place;
  double least = 1;  // cosine of how far the texels reach
  for (const LightTexel& t : texels) {
    by_place[t.at] = &t;
    least = std::min(least, glm::dot(t.direction, from));
  }
  const int size = map.grid().size;
  const double reach = std::acos(least) + 2.0 / size;
  TexelState& state = map.state;
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    const TileOutlines& outlines = map.geometry.outlines;
    const double most = std::min(reach + outlines.reach(tile), double(kPi));
    if (!map.above(tile) || glm::dot(outlines.middle(tile), towards) < std::cos(most)) continue;
    bool any = false;
    each_texel(tile, map, [&](int k, const glm::dvec3& direction) {
      const TexelPlace old = texel_at(glm::vec3(back * direction), size);
      const TilePlace last = tile_place(map.grid(), old.face, old.x, old.y);
      const auto found = by_place.find(map.geometry.start(last.tile) + std::size_t(last.texel));
      if (found == by_place.end() || !(direction.z > 0)) return;
      const LightTexel& t = *found->second;
      const std::size_t to = map.geometry.start(tile) + std::size_t(k);
      const float has = state.value[0][to] + state.value[1][to] + state.value[2][to];
      if (state.last_seen.at(tile, k) > kNever && has >= t.sum()) return;
      for (int c = 0; c < 3; ++c) {
        const float blur = kMoved * t.value[c];
        state.value[c][to] = t.value[c], state.variance[c][to] = t.variance[c] + blur * blur;
      }
      state.bound[to] = t.bound;
      state.last_seen.texels(tile)[k] = t.seen;
      any = true;
    });
    if (!any) continue;
    relate_variances(state, map.geometry.start(tile), map.geometry.texels(tile));
    map.sum(tile);
    changed.push_back(tile);
  }
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

std::vector<int> move_lights(std::span<const LightPosition> lights, const std::vector<int>& moved,
                             const PlaceLayout& place, double bright, MapTiles& map) {
  const TileOutlines& outlines = map.geometry.outlines;
  struct Moved {
    glm::dvec3 towards;
    double radius;
    std::vector<glm::dvec3> ghosts;
    std::vector<LightTexel> texels;
  };
  std::vector<Moved> all;
  for (const LightPosition& light : lights) {
    Moved m{glm::normalize(light.position - place.centre()),
            angular_radius(light, place.centre()),
            {},
            {}};
    for (const LightTracks::Sight& sight : place.tracks().sights(light))
      m.ghosts.push_back(place.surface().recorded(sight.eye, sight.direction));
    if (!m.ghosts.empty()) all.push_back(std::move(m));
  }
  std::vector<int> changed;
  if (all.empty()) return changed;
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    if (!map.above(tile) || !map.was_seen(tile)) continue;
    const glm::dvec3 at = outlines.middle(tile);
    auto whose = std::ranges::find_if(all, [&](const Moved& m) {
      const double reach = kOutline * m.radius + kBlur + outlines.reach(tile);
      return std::ranges::any_of(
          m.ghosts, [&](const glm::dvec3& ghost) { return glm::dot(ghost, at) > std::cos(reach); });
    });
    if (whose == all.end() && std::ranges::find(moved, tile) != moved.end())
      whose = std::ranges::max_element(all, {},
                                       [&](const Moved& m) { return glm::dot(m.towards, at); });
    if (whose != all.end() && forget_bright(tile, bright, map, whose->texels))
      changed.push_back(tile);
  }
  for (Moved& m : all)
    if (!m.texels.empty()) show(std::move(m.texels), m.towards, map, changed);
  std::ranges::sort(changed);
  changed.erase(std::ranges::unique(changed).begin(), changed.end());
  const std::uint64_t version = new_tile_version();
  for (const int tile : changed) map.versions[std::size_t(tile)] = version;
  return changed;
}

}  // namespace fastibl
