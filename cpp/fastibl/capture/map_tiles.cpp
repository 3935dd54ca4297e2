#include "fastibl/capture/map_tiles.h"

#include "fastibl/core/prefetch.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

MapTiles::MapTiles(TileGrid grid)
    : geometry(grid),
      state(grid),
      sums(std::size_t(grid.count())),
      versions(std::size_t(grid.count()), new_tile_version()),
      boosts(std::size_t(grid.count())),
      pyramids(grid),
      quiet(grid) {}

bool MapTiles::any_bounds() const {
  for (int tile = 0; tile < grid().count(); ++tile)
    if (has_bounds(tile)) return true;
  return false;
}

glm::dvec3 MapTiles::seen_sky_irradiance() const {
  glm::dvec3 sum(0);
  for (int tile = 0; tile < grid().count(); ++tile)
    if (above(tile)) sum += sums[std::size_t(tile)].irradiance;
  return sum;
}

double MapTiles::seen_sky_share() const {
  double seen = 0, sky = 0;
  for (int tile = 0; tile < grid().count(); ++tile) {
    if (!above(tile)) continue;
    const std::size_t i = std::size_t(tile);
    seen += sums[i].projected, sky += geometry.tile_projected[i];
  }
  return seen / sky;
}

std::vector<double> MapTiles::last_seen() const {
  const std::size_t n = std::size_t(grid().size);
  std::vector<double> out(6 * n * n);
  for (int tile = 0; tile < grid().count(); ++tile) {
    const FaceRect r = tile_rect(grid(), tile);
    int from = 0;
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
        out[(std::size_t(r.face) * n + std::size_t(y)) * n + std::size_t(x)] =
            state.last_seen.at(tile, from++);
  }
  return out;
}

std::array<const float*, 3> MapTiles::shown_texels(int tile, std::vector<float>& room) const {
  const std::size_t stride = std::size_t(grid().stride()), start = geometry.start(tile);
  if (!has_bounds(tile) || !boosts[std::size_t(tile)].any())
    return {&state.value[0][start], &state.value[1][start], &state.value[2][start]};
  room = boosted(boosts[std::size_t(tile)], state, start, geometry.texels(tile),
                 geometry.angles(tile), geometry.projected(tile), grid().stride());
  return {&room[0], &room[stride], &room[2 * stride]};
}

void MapTiles::prefetch(int tile) const {
  const std::size_t start = geometry.start(tile), count = std::size_t(grid().stride());
  for (int c = 0; c < 3; ++c) {
    prefetch_items(&state.value[c][start], count);
    prefetch_items(&state.variance[c][start], count);
  }
  prefetch_items(&state.bound[start], count);
  prefetch_items(&state.relative[start], count);
  prefetch_items(geometry.projected(tile), count);
}

void MapTiles::sum(int tile) {
  sums[std::size_t(tile)] =
      sum_tile(state, geometry.start(tile), geometry.texels(tile), state.last_seen.own(tile),
               geometry.angles(tile), geometry.projected(tile));
}

void MapTiles::make_levels(int tile) {
  std::vector<float> room;
  pyramids.make(tile, shown_texels(tile, room).data());
  quiet.place_probes(tile, pyramids);
}

void MapTiles::distrust(double share) {
  fastibl::distrust(state, share);
  const std::uint64_t version = new_tile_version();
  for (int tile = 0; tile < grid().count(); ++tile) {
    relate_variances(state, geometry.start(tile), geometry.texels(tile));
    versions[std::size_t(tile)] = version;
  }
}

void MapTiles::renew() {
  quiet = QuietTiles(grid());
  const std::uint64_t version = new_tile_version();
  for (int tile = 0; tile < grid().count(); ++tile) {
    relate_variances(state, geometry.start(tile), geometry.texels(tile));
    sum(tile);
    if (state.last_seen.same(tile) && state.last_seen.at(tile, 0) == kNever)
      sums[std::size_t(tile)] = TileSums{};
    versions[std::size_t(tile)] = version;
  }
}

}  // namespace fastibl
