#include "fastibl/capture/move_map.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr double kFarAway = 1e9;  // metres
constexpr int kRounds = 3;

// Every texel above the horizon takes what `old` held in source(tile, direction), std::nullopt for
// nothing.
template <class Source>
void resample(const TexelState& old, const Source& source, MapTiles& map) {
  TexelState& state = map.state;
  const std::size_t stride = std::size_t(map.grid().stride());
  const float half = 0.4f / float(map.grid().size);
  // Averages those of the four texels around a texel's place that were seen, as if looked up there.
  const auto take = [&](int tile, int k, const std::optional<glm::vec3>& direction) {
    float count = 0, value[3] = {}, variance[3] = {};
    double seen = kNever;
    std::uint8_t bound = 0;
    for (int corner = 0; direction && corner < 4; ++corner) {
      const glm::vec3 side = glm::normalize(glm::cross(
          *direction, std::abs(direction->z) < 0.9f ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0)));
      const glm::vec3 other = glm::cross(*direction, side);
      const glm::vec3 d = *direction + half * ((corner & 1 ? 1.0f : -1.0f) * side +
                                               (corner & 2 ? 1.0f : -1.0f) * other);
      if (!(d.z > 0)) continue;  // the plane
      const TexelPlace at = texel_at(d, map.grid().size);
      const TilePlace from = tile_place(map.grid(), at.face, at.x, at.y);
      const double time = old.last_seen.at(from.tile, from.texel);
      if (!(time > kNever)) continue;
      const std::size_t i = std::size_t(from.tile) * stride + std::size_t(from.texel);
      for (int c = 0; c < 3; ++c) value[c] += old.value[c][i], variance[c] += old.variance[c][i];
      bound |= old.bound[i], seen = std::max(seen, time), ++count;
    }
    if (count == 0 && !(state.last_seen.at(tile, k) > kNever)) return;
    const std::size_t to = std::size_t(tile) * stride + std::size_t(k);
    for (int c = 0; c < 3; ++c) {
      state.value[c][to] = count > 0 ? value[c] / count : 0;
      // Adds what may differ within a texel.
      const float blur = kModelNoise * state.value[c][to];
      state.variance[c][to] = count > 0 ? variance[c] / count + blur * blur : 0;
    }
    state.bound[to] = bound;
    state.last_seen.texels(tile)[k] = seen;
  };
  parallel_for(map.grid().count(), 32, [&](int begin, int end) {
    for (int tile = begin; tile < end; ++tile) {
      if (!map.above(tile)) continue;
      const FaceRect r = tile_rect(map.grid(), tile);
      int k = 0;
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x, ++k) {
          const glm::vec3 d = glm::normalize(texel_direction(r.face, x, y, map.grid().size));
          if (d.z > 0) take(tile, k, source(tile, d));
        }
    }
  });
}

}  // namespace

void turn_map(const glm::dmat3& new_from_old, MapTiles& map) {
  const glm::mat3 old_from_new(glm::transpose(new_from_old));
  const TexelState old = std::exchange(map.state, TexelState(map.grid()));
  resample(
      old, [&](int, const glm::vec3& d) { return std::optional(old_from_new * d); }, map);
  map.renew();
}

std::vector<int> move_map(const Surroundings& before, const PlaceLayout& place,
                          const TileViews& views, MapTiles& map) {
  const MapSurface& surface = place.surface();
  const std::vector<glm::dvec3>& eyes = views.eyes;
  // For tiles that were not seen, the mean of where others were seen from: what belongs there was
  // recorded beside it.
  glm::dvec3 usual_eye(0);
  double seen = 0;
  for (std::size_t i = 0; i < eyes.size(); ++i)
    if (map.sums[i].count > 0) usual_eye += eyes[i], ++seen;
  if (seen > 0) usual_eye /= seen;
  // Where a point was recorded depends on where its tile was seen from, and that on the tile.
  const auto recorded_in = [&](int tile, const glm::dvec3& direction) {
    const double nearness = std::max(surface.nearness(direction), 1 / kFarAway);
    const glm::dvec3 point = place.centre() + direction / nearness;
    glm::dvec3 there = direction;
    for (int round = 0; round < kRounds; ++round) {
      const std::size_t from =
          round == 0 ? std::size_t(tile) : std::size_t(map.geometry.tile_in(there));
      const glm::dvec3& eye = map.sums[from].count > 0 ? eyes[from] : usual_eye;
      if (!std::isfinite(eye.x)) return direction;
      there = before.surface().recorded(eye, glm::normalize(point - eye));
    }
    return there;
  };
  const TexelState old = map.state;
  resample(
      old,
      [&](int tile, const glm::vec3& d) -> std::optional<glm::vec3> {
        if (!before.is_usual(before.depth(tile))) return d;
        const glm::vec3 there(recorded_in(tile, glm::dvec3(d)));
        // What a light's tiles show was recorded where it is.
        return before.is_usual(before.depth(map.geometry.tile_in(there))) ? std::optional(there)
                                                                          : std::nullopt;
      },
      map);
  std::vector<int> from(eyes.size());
  std::iota(from.begin(), from.end(), 0);
  for (int tile = 0; tile < map.grid().count(); ++tile)
    if (map.above(tile))
      from[std::size_t(tile)] =
          map.geometry.tile_in(recorded_in(tile, map.geometry.outlines.middle(tile)));
  map.renew();
  return from;
}

}  // namespace fastibl
