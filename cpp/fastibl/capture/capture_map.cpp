// The maps that a Capture hands out.
#include <algorithm>
#include <numbers>
#include <utility>

#include "fastibl/capture/capture.h"
#include "fastibl/capture/expected_error.h"
#include "fastibl/core/prefetch.h"
#include "fastibl/core/simd.h"
#include "fastibl/core/sole_owner.h"

namespace fastibl {
namespace {

constexpr std::size_t kSnapshots = 3;   // kept to be updated: in use by renderer, caller and us
constexpr std::size_t kTilesAhead = 2;  // whose rows are prefetched while a tile is written
constexpr double kKnownPlane = 0.25;    // share of the plane's half that tells its albedo

// How little of the plane was seen, 0 to 1, from the solid angle of its seen part.
double little_of(double seen) {
  return std::max(0.0, 1 - seen / (kKnownPlane * 2 * std::numbers::pi));
}

// Writes rows of `width` texels as the map has them, with rows `stride` floats apart.
FASTIBL_CLONES void interleave(const float* const channels[3], int width, int height,
                               std::ptrdiff_t stride, float* __restrict map) {
  const float *r = channels[0], *g = channels[1], *b = channels[2];
  const auto at = [](const float* p) -> Float8 { return *reinterpret_cast<const Float8*>(p); };
  for (int row = 0; row < height; ++row, map += stride) {
    float* out = map;
    int i = 0;
    for (; i + 8 <= width; i += 8, out += 24) {
      const Float8 &x = at(r + i), &y = at(g + i), &z = at(b + i);
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

}  // namespace

std::shared_ptr<const Environment> Capture::environment() {
  // A map that only this list still holds can be changed: nobody can get hold of it meanwhile.
  std::shared_ptr<Environment> snapshot;
  for (std::size_t i = 0; i < snapshots_.size() && !snapshot; ++i)
    if (is_sole_owner(snapshots_[i])) {
      snapshot = std::move(snapshots_[i]);
      snapshots_.erase(snapshots_.begin() + std::ptrdiff_t(i));
    }
  if (!snapshot) {
    snapshot = std::make_shared<Environment>();
    snapshot->radiance = CubeMap(map_.grid().size);
    snapshot->last_seen = TexelTimes(map_.grid());
    snapshot->variance.assign(map_.state.relative.size(), 0);
  }
  update_snapshot(*snapshot);
  snapshots_.insert(snapshots_.begin(), snapshot);
  if (snapshots_.size() > kSnapshots) snapshots_.pop_back();
  return snapshot;
}

void Capture::update_snapshot(Environment& snapshot) const {
  CubeMap& map = snapshot.radiance;
  std::vector<int> stale;
  for (int tile = 0; tile < map_.grid().count(); ++tile)
    if (map.tile_version(tile) != map_.versions[std::size_t(tile)]) stale.push_back(tile);
  for (std::size_t i = 0; i < stale.size(); ++i) {
    if (i + kTilesAhead < stale.size()) prefetch_rows(stale[i + kTilesAhead], map);
    write_tile(stale[i], snapshot);
  }
  map.update(stale, map_.pyramids.levels());
  for (const int tile : stale) map.set_tile_version(tile, map_.versions[std::size_t(tile)]);

  double up = 0, up_seen = 0, seen = 0, bound = 0, bound_flux = 0, up_flux = 0, flux = 0, fills = 0;
  double from_prior = 0, plane_seen = 0, plane_fills = 0;
  for (int tile = 0; tile < map_.grid().count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    const TileSums& s = map_.sums[i];
    const double filled = fills_.flux(tile, map_);
    const double all = s.flux.x + s.flux.y + s.flux.z + filled;
    seen += s.angle, bound += s.bound_angle, flux += all, fills += filled;
    if (!map_.above(tile)) {
      plane_seen += s.angle, plane_fills += filled;
      continue;
    }
    from_prior += fills_.has_prior(tile, map_) ? filled : 0;
    up += map_.geometry.tile_angle[i], up_seen += s.angle, bound_flux += s.bound_flux,
        up_flux += all;
  }
  const glm::dvec3 more = map_.boosted_flux();
  const double boosted = more.x + more.y + more.z;
  flux += boosted, up_flux += boosted;
  snapshot.time = time_;
  snapshot.centre = options_.centre, snapshot.box = place_.told_box();
  snapshot.plane_irradiance = meter_.irradiance();
  snapshot.light_positions = place_.tracks().positions();
  snapshot.coverage = seen / (4 * std::numbers::pi);
  snapshot.clipped = seen > 0 ? bound / seen : 0;
  const PlaceLayout::Parallax near = place_.parallax();
  snapshot.knowledge = {1 - up_seen / up,
                        flux > 0 ? fills / flux : 1,
                        flux > 0 ? little_of(plane_seen) * plane_fills / flux : 0,
                        up_flux > 0 ? bound_flux / up_flux : 0,
                        near.expected,
                        near.doubt,
                        flux > 0 ? from_prior / flux : 0,
                        up_flux > 0 ? boosted / up_flux : 0,
                        meter_.irradiance().has_value(),
                        options_.most_boost > 1 && meter_.irradiance(),
                        scale_error()};
  const ErrorInterval error = expected_error(snapshot.knowledge);
  snapshot.predicted_error = error.expected;
  snapshot.predicted_low = error.low, snapshot.predicted_high = error.high;
}

void Capture::prefetch_rows(int tile, const CubeMap& map) const {
  const FaceRect r = tile_rect(map_.grid(), tile);
  const std::size_t start = map_.geometry.start(tile);
  for (int k = 0; k < std::min(2, map_.pyramids.levels()); ++k) {
    const CubeLevel& level = map.level(k);
    for (int y = r.y0 >> k; y < r.y1 >> k; ++y)
      prefetch_items(&level.texel(r.face, r.x0 >> k, y), std::size_t(r.width() >> k));
  }
  for (int c = 0; c < 3; ++c)
    prefetch_items(&map_.state.value[c][start], std::size_t(map_.grid().stride()));
}

void Capture::write_tile(int tile, Environment& snapshot) const {
  const FaceRect r = tile_rect(map_.grid(), tile);
  CubeMap& map = snapshot.radiance;
  const std::size_t start = map_.geometry.start(tile);
  const auto write = [&](int level, const std::array<const float*, 3>& channels) {
    CubeLevel& to = map.base(level);
    interleave(channels.data(), r.width() >> level, r.height() >> level, 3 * to.row_stride(),
               &to.texel(r.face, r.x0 >> level, r.y0 >> level).x);
  };
  std::vector<float> room;
  write(0, map_.shown_texels(tile, room));
  for (int k = 1; k < map_.pyramids.levels(); ++k)
    write(k, {map_.pyramids.level(tile, 0, k), map_.pyramids.level(tile, 1, k),
              map_.pyramids.level(tile, 2, k)});
  std::copy_n(&map_.state.relative[start], map_.grid().stride(), &snapshot.variance[start]);
  snapshot.last_seen.copy(tile, map_.state.last_seen);
}

}  // namespace fastibl
