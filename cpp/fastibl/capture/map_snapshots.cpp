#include "fastibl/capture/map_snapshots.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "fastibl/core/prefetch.h"
#include "fastibl/core/simd.h"
#include "fastibl/core/sole_owner.h"

namespace fastibl {
namespace {

constexpr std::size_t kSnapshots = 3;   // kept to be updated: in use by renderer, caller and us
constexpr std::size_t kTilesAhead = 2;  // whose rows are prefetched while a tile is written

// Writes rows of `width` texels as the map has them, with rows `stride` floats apart.
FASTIBL_CLONES void interleave(const float* const channels[3], int width, int height,
                               std::ptrdiff_t stride, float* __restrict map) {
  const float *r = channels[0], *g = channels[1], *b = channels[2];
  for (int row = 0; row < height; ++row, map += stride) {
    float* out = map;
    int i = 0;
    for (; i + 8 <= width; i += 8, out += 24) {
      const Float8 &x = floats_at<Float8>(r + i), &y = floats_at<Float8>(g + i),
                   &z = floats_at<Float8>(b + i);
      const Float8 p = __builtin_shufflevector(x, y, 0, 8, 0, 1, 9, 0, 2, 10);
      const Float8 q = __builtin_shufflevector(x, y, 0, 3, 11, 0, 4, 12, 0, 5);
      const Float8 s = __builtin_shufflevector(x, y, 13, 0, 6, 14, 0, 7, 15, 0);
      *reinterpret_cast<Float8*>(out) = __builtin_shufflevector(p, z, 0, 1, 8, 3, 4, 9, 6, 7);
      *reinterpret_cast<Float8*>(out + 8) =
          __builtin_shufflevector(q, z, 10, 1, 2, 11, 4, 5, 12, 7);
      *reinterpret_cast<Float8*>(out + 16) =
          __builtin_shufflevector(s, z, 0, 13, 2, 3, 14, 5, 6, 15);
    }
    for (; i < width; ++i, out += 3) out[0] = r[i], out[1] = g[i], out[2] = b[i];
    r += width, g += width, b += width;
  }
}

void prefetch_rows(const MapTiles& map, int tile, const CubeMap& radiance) {
  const FaceRect r = tile_rect(map.grid(), tile);
  const std::size_t start = map.geometry.start(tile);
  for (int k = 0; k < std::min(2, map.pyramids.levels()); ++k) {
    const CubeLevel& level = radiance.level(k);
    for (int y = r.y0 >> k; y < r.y1 >> k; ++y)
      prefetch_items(&level.texel(r.face, r.x0 >> k, y), std::size_t(r.width() >> k));
  }
  for (int c = 0; c < 3; ++c)
    prefetch_items(&map.state.value[c][start], std::size_t(map.grid().stride()));
}

void write_tile(const MapTiles& map, int tile, Environment& snapshot) {
  const FaceRect r = tile_rect(map.grid(), tile);
  const std::size_t start = map.geometry.start(tile);
  const auto write = [&](int level, const std::array<const float*, 3>& channels) {
    CubeLevel& to = snapshot.radiance.base(level);
    interleave(channels.data(), r.width() >> level, r.height() >> level, 3 * to.row_stride(),
               &to.texel(r.face, r.x0 >> level, r.y0 >> level).x);
  };
  std::vector<float> room;
  write(0, map.shown_texels(tile, room));
  for (int k = 1; k < map.pyramids.levels(); ++k)
    write(k, {map.pyramids.level(tile, 0, k), map.pyramids.level(tile, 1, k),
              map.pyramids.level(tile, 2, k)});
  std::copy_n(&map.state.relative[start], map.grid().stride(), &snapshot.variance[start]);
  snapshot.last_seen.copy(tile, map.state.last_seen);
}

}  // namespace

std::shared_ptr<Environment> MapSnapshots::take(const MapTiles& map) {
  std::shared_ptr<Environment> snapshot = free_snapshot(map);
  CubeMap& radiance = snapshot->radiance;
  std::vector<int> stale;
  for (int tile = 0; tile < map.grid().count(); ++tile)
    if (radiance.tile_version(tile) != map.versions[std::size_t(tile)]) stale.push_back(tile);
  for (std::size_t i = 0; i < stale.size(); ++i) {
    if (i + kTilesAhead < stale.size()) prefetch_rows(map, stale[i + kTilesAhead], radiance);
    write_tile(map, stale[i], *snapshot);
  }
  radiance.update(stale, map.pyramids.levels());
  for (const int tile : stale) radiance.set_tile_version(tile, map.versions[std::size_t(tile)]);
  snapshots_.insert(snapshots_.begin(), snapshot);
  if (snapshots_.size() > kSnapshots) snapshots_.pop_back();
  return snapshot;
}

// A map that only this list still holds can be changed: nobody can get hold of it meanwhile.
std::shared_ptr<Environment> MapSnapshots::free_snapshot(const MapTiles& map) {
  std::shared_ptr<Environment> snapshot;
  for (std::size_t i = 0; i < snapshots_.size() && !snapshot; ++i)
    if (is_sole_owner(snapshots_[i])) {
      snapshot = std::move(snapshots_[i]);
      snapshots_.erase(snapshots_.begin() + std::ptrdiff_t(i));
    }
  if (snapshot) return snapshot;
  snapshot = std::make_shared<Environment>();
  snapshot->radiance = CubeMap(map.grid().size);
  snapshot->last_seen = TexelTimes(map.grid());
  snapshot->variance.assign(map.state.relative.size(), 0);
  return snapshot;
}

}  // namespace fastibl
