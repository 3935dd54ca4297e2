#include "fastibl/capture/map_fills.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "fastibl/capture/light_meter.h"

namespace fastibl {
namespace {

// Seconds over which new values of unseen tiles are spread, and the least share that one picture
// makes: unseen tiles hold a guess, which follows when there is time.
constexpr double kRefillTime = 0.3, kLeastRefill = 1 / 32.0;
constexpr float kSmallRefill = 0.05f;  // relative change that may take kSmallLater times as long
constexpr int kSmallLater = 12;
constexpr int kPicturesPerFill = 2;  // between updates of what unseen tiles should hold
constexpr float kOtherScale = 0.5f;  // change of a prior map's brightness that is shown at once

}  // namespace

MapFills::MapFills(const CaptureOptions& options, MapTiles& map)
    : plane_albedo_(float(options.plane_albedo)),
      clipped_(map.grid()),
      unseen_(map.grid(), plane_albedo_),
      filled_(std::size_t(map.grid().count())),
      stale_fill_(std::size_t(map.grid().count()), 0) {
  if (options.prior) {
    prior_.emplace(options.prior, map.grid());
    for (int tile = 0; tile < map.grid().count(); ++tile)
      if (map.above(tile)) sky_.push_back(tile);
    give_prior();
    std::vector<int> all;
    unseen_.update({}, map.sums, map.geometry.tile_projected, 0, true, all);
  }
  for (int tile = 0; tile < map.grid().count(); ++tile) refill(tile, map);
}

void MapFills::give_prior() {
  unseen_.give_sky();
  for (const int tile : sky_) unseen_.give(tile, prior_->mean(tile));
}

double MapFills::mean_radiance(const MapTiles& map) const {
  double sum = 0, angle = 0;
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    const TileSums& sums = map.sums[std::size_t(tile)];
    angle += sums.angle;
    sum += sums.flux.x + sums.flux.y + sums.flux.z + flux(tile, map);
  }
  return angle > 0 ? sum / (3 * 4 * std::numbers::pi) : 0;
}

glm::dvec3 MapFills::sky_irradiance(const MapTiles& map) const {
  return unseen_.sky_irradiance(map.sums, map.geometry.tile_projected);
}

void MapFills::measure_plane(const glm::dvec3& irradiance) {
  unseen_.measure_plane(irradiance, kMeterDeviation * irradiance);
}

int MapFills::refills_after(double time, bool still) const {
  const bool all = still || (time == last_taken_ && all_then_);
  const double share = all ? 1 : std::clamp((time - last_taken_) / kRefillTime, kLeastRefill, 1.0);
  return int(share * double(filled_.size()));
}

void MapFills::take(const std::vector<int>& changed, int refills,
                    const std::optional<glm::dvec3>& plane_irradiance, double time, MapTiles& map) {
  const int all = map.grid().count();
  std::vector<int> refilled, boosted;
  last_taken_ = time, all_then_ = refills == all;
  new_sums_.insert(new_sums_.end(), changed.begin(), changed.end());
  if (plane_irradiance) boosted = weigh_bounds(*plane_irradiance, map);
  const bool unmatched = prior_ && !prior_->matched();
  if (refills == all || unmatched || ++pictures_ % kPicturesPerFill == 0) {
    if (prior_ && match_prior(plane_irradiance, map, refilled)) refills = all;
    unseen_.update(new_sums_, map.sums, map.geometry.tile_projected, time, refills == all,
                   refilled);
    new_sums_.clear();
  }
  const std::uint64_t version = new_tile_version();
  for (const int tile : changed) map.versions[std::size_t(tile)] = version, refill(tile, map);
  for (const int tile : boosted) map.versions[std::size_t(tile)] = version, map.make_levels(tile);
  for (const int tile : refilled) stale_fill_[std::size_t(tile)] = 1;
  refill_stale(refills, version, map);
}

void MapFills::refill_stale(int refills, std::uint64_t version, MapTiles& map) {
  const int all = map.grid().count();
  int small_refills = refills == all ? refills : refills / kSmallLater;
  for (int i = 0; i < all && refills > 0; ++i) {
    next_refill_ = (next_refill_ + 1) % all;
    if (!stale_fill_[std::size_t(next_refill_)]) continue;
    const bool small = is_small_refill(next_refill_);
    if ((small && small_refills == 0) || !refill(next_refill_, map)) continue;
    map.versions[std::size_t(next_refill_)] = version;
    --refills, small_refills -= small;
  }
}

bool MapFills::is_small_refill(int tile) const {
  const glm::vec3 from = filled_[std::size_t(tile)];
  const glm::vec3 step = glm::abs(unseen_.middle(tile) - from), limit = kSmallRefill * from;
  return step.x <= limit.x && step.y <= limit.y && step.z <= limit.z;
}

void MapFills::refill(const std::vector<int>& changed, MapTiles& map) {
  new_sums_.insert(new_sums_.end(), changed.begin(), changed.end());
  for (const int tile : changed)
    if (!refill(tile, map)) map.make_levels(tile);
}

void MapFills::renew(double time, MapTiles& map) {
  std::vector<int> all(std::size_t(map.grid().count())), refilled;
  std::iota(all.begin(), all.end(), 0);
  new_sums_.clear();
  clipped_.forget(map);
  unseen_.update(all, map.sums, map.geometry.tile_projected, time, true, refilled);
  for (const int tile : all)
    if (!refill(tile, map)) map.make_levels(tile);
}

void MapFills::turn(const glm::dmat3& new_from_old,
                    const std::optional<glm::dvec3>& plane_irradiance, double time, MapTiles& map) {
  unseen_ = UnseenTiles(map.grid(), plane_albedo_);
  if (prior_) prior_->turn(new_from_old), give_prior();
  if (plane_irradiance) measure_plane(*plane_irradiance);
  renew(time, map);
}

bool MapFills::refill(int tile, MapTiles& map) {
  stale_fill_[std::size_t(tile)] = 0;
  if (map.was_seen_whole(tile)) return false;
  if (prior_ && map.above(tile)) {
    refill_from_prior(tile, map);
    return true;
  }
  const FillPatch fill = unseen_.fill(tile);
  filled_[std::size_t(tile)] = fill.mean();
  TexelState& state = map.state;
  const std::size_t start = map.geometry.start(tile);
  float* const texels[3] = {&state.value[0][start], &state.value[1][start], &state.value[2][start]};
  const bool seen = map.was_seen(tile);
  lay_patch(fill, tile_rect(map.grid(), tile), seen ? state.last_seen.texels(tile) : nullptr,
            texels);
  if (seen)
    map.make_levels(tile);
  else
    map.pyramids.make(tile, texels);
  return true;
}

void MapFills::refill_from_prior(int tile, MapTiles& map) {
  TexelState& state = map.state;
  const std::size_t start = map.geometry.start(tile);
  const float* angles = map.geometry.angles(tile);
  glm::dvec3 flux(0);
  double angle = 0;
  for (int k = 0; k < map.geometry.texels(tile); ++k) {
    if (state.last_seen.at(tile, k) > kNever) continue;
    const glm::vec3 value = prior_->texel(tile, k);
    for (int c = 0; c < 3; ++c) state.value[c][start + std::size_t(k)] = value[c];
    flux += double(angles[k]) * glm::dvec3(value), angle += double(angles[k]);
  }
  filled_[std::size_t(tile)] = glm::vec3(flux / angle);
  map.make_levels(tile);
}

bool MapFills::match_prior(const std::optional<glm::dvec3>& plane_irradiance, const MapTiles& map,
                           std::vector<int>& refilled) {
  const TileGeometry& geometry = map.geometry;
  const float moved =
      prior_->match(map.sums, geometry.tile_angle, geometry.tile_projected, sky_, plane_irradiance);
  if (!(moved > 0)) return false;
  for (const int tile : sky_) {
    unseen_.give(tile, prior_->mean(tile));
    if (!map.was_seen_whole(tile)) refilled.push_back(tile);
  }
  return moved > kOtherScale;
}

std::vector<int> MapFills::weigh_bounds(const glm::dvec3& plane_irradiance, MapTiles& map) {
  if (!map.any_bounds() && !clipped_.any()) return {};
  // The unseen light may be brighter by as much again, or not there.
  const glm::dvec3 unseen = sky_irradiance(map), unsure = kMeterDeviation * plane_irradiance;
  const MissingLight missing{plane_irradiance - map.seen_sky_irradiance() - unseen,
                             glm::sqrt(unseen * unseen + unsure * unsure), map.seen_sky_share()};
  const std::vector<int> shown = clipped_.weigh(missing, most_boost_, map);
  // No light is counted twice: only the rest may be in what was not seen.
  unseen_.measure_plane(plane_irradiance - clipped_.added(), unsure);
  return shown;
}

}  // namespace fastibl
