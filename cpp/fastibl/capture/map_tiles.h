// The map by tiles: what is known of each texel, and what follows from that.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "fastibl/capture/clipped_texels.h"
#include "fastibl/capture/quiet_tiles.h"
#include "fastibl/capture/texel_state.h"
#include "fastibl/capture/tile_geometry.h"
#include "fastibl/capture/tile_pyramids.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

struct MapTiles {
  explicit MapTiles(TileGrid grid);

  const TileGrid& grid() const { return geometry.grid; }
  bool above(int tile) const { return geometry.above(tile); }
  bool was_seen(int tile) const { return sums[std::size_t(tile)].count > 0; }  // any of it
  bool was_seen_whole(int tile) const {
    return sums[std::size_t(tile)].count == geometry.texels(tile);
  }
  // Whether the tile shows light that clips, which may be boosted.
  bool has_bounds(int tile) const { return above(tile) && sums[std::size_t(tile)].bound_angle > 0; }
  bool any_bounds() const;
  glm::dvec3 seen_sky_irradiance() const;  // of the plane
  double seen_sky_share() const;           // of the sky, by what it lights of the plane
  std::vector<double> last_seen() const;   // 6 n²: seconds; −∞ if never

  // The tile's texels by channel, as maps have them; boosted ones are written to `room`.
  std::array<const float*, 3> shown_texels(int tile, std::vector<float>& room) const;
  // Fetches what a picture changes of a tile.
  void prefetch(int tile) const;

  void sum(int tile);           // renews its sums
  void make_levels(int tile);   // for one of which any texel was seen
  void distrust(double share);  // lets all values be wrong by this
  // Renews the sums and versions of all tiles, and forgets what pictures agreed with.
  void renew();

  TileGeometry geometry;
  TexelState state;
  std::vector<TileSums> sums;           // by tile
  std::vector<std::uint64_t> versions;  // by tile, as the map's
  std::vector<LightBoost> boosts;       // by tile
  TilePyramids pyramids;
  QuietTiles quiet;
};

}  // namespace fastibl
