#include "fastibl/capture/assumed_scale.h"

#include <algorithm>
#include <cmath>

#include "fastibl/capture/light_meter.h"
#include "fastibl/capture/plane_meter.h"
#include "fastibl/capture/texel_state.h"

namespace fastibl {
namespace {

constexpr int kNoScale = 0, kOwnScale = -1;  // of a tile

constexpr double kLeastSeen = 0.25;  // of the sky, by what it lights: with less, little is known
constexpr double kLessUnseen = 2.0 / 3;  // left of the unseen part before the white is asked again,
constexpr double kAllSeen = 0.98;        // until so much was seen: after that the light may change
// ln: a scale that is off by less stays. kGood is for a sky that was seen whole, kGuess for one
// that was not seen. The first picture is seldom further off, and what was not seen is filled as
// the white says in any case.
constexpr double kGood = 0.1, kGuess = 0.75;

// ln: what the white says of the scale may change by this before that is believed, as a fifth
// brighter or darker is nothing to wonder about, and for how long, seconds.
constexpr double kDrift = 0.18, kDrifts = 0.2;
constexpr double kSameShare = 0.02;  // of the sky: as much was seen

}  // namespace

AssumedScale::AssumedScale(TileGrid grid) : scales_(std::size_t(grid.count()), kNoScale) {}

double scale_error(const glm::dvec3& sky_irradiance,
                   const std::optional<glm::dvec3>& plane_irradiance) {
  if (!plane_irradiance) return 1;
  const double ratio = grey(sky_irradiance) / grey(*plane_irradiance);
  return std::isfinite(ratio) ? std::max(std::abs(ratio - 1), kMeterDeviation) : 1;
}

void AssumedScale::note(const std::vector<int>& tiles, int assumed_of, bool untold) {
  for (const int tile : tiles) {
    int& scale = scales_[std::size_t(tile)];
    if (scale == kNoScale)
      scale = assumed_of > 0 ? assumed_of : kOwnScale;
    else if (!untold)
      scale = kOwnScale;
  }
}

void AssumedScale::know(int camera) {
  std::replace(scales_.begin(), scales_.end(), camera, kOwnScale);
}

void AssumedScale::move(const std::vector<int>& from) {
  const std::vector<int> before = scales_;
  for (std::size_t i = 0; i < from.size(); ++i) scales_[i] = before[std::size_t(from[i])];
}

// What was in one scale still is; of several, none is known any more.
void AssumedScale::mix(const MapTiles& map) {
  int common = kNoScale;
  for (int tile = 0; tile < map.grid().count(); ++tile)
    if (const int scale = scales_[std::size_t(tile)]; map.above(tile) && scale != kNoScale)
      common = common == kNoScale || common == scale ? scale : kOwnScale;
  for (int tile = 0; tile < map.grid().count(); ++tile)
    scales_[std::size_t(tile)] = map.above(tile) && map.was_seen(tile) ? common : kNoScale;
}

bool AssumedScale::any(const MapTiles& map) const {
  for (int tile = 0; tile < map.grid().count(); ++tile)
    if (scales_[std::size_t(tile)] > 0 && map.was_seen(tile)) return true;
  return false;
}

// The unseen sky is taken to be as bright as the seen part. The more was seen, the better the scale
// is known, so the white is asked again whenever more was seen. As the same part is seen, what
// changes is the light, which pictures of cameras that tell no exposure do not show.
std::optional<double> AssumedScale::mending(double share, double factor, bool follow, double time) {
  if (scaled_at_ <= kAllSeen && share >= kLeastSeen &&
      1 - share <= kLessUnseen * (1 - scaled_at_)) {
    scaled_at_ = share;
    const bool good = std::abs(std::log(factor)) <= kGuess + share * (kGood - kGuess);
    balance_ = Balance{good ? factor : 1, share, time};
    return good ? std::nullopt : std::optional(factor);
  }
  if (!follow || !balance_ || std::abs(share - balance_->share) > kSameShare)
    balance_ = Balance{factor, share, time};
  const double drift = factor / balance_->factor;
  if (std::abs(std::log(drift)) <= kDrift) balance_->since = time;
  if (time - balance_->since < kDrifts) return std::nullopt;
  balance_->since = time;
  return drift;
}

void AssumedScale::mend(MapTiles& map, const glm::dvec3& plane_irradiance, double time,
                        std::vector<int>& changed) {
  double known = 0, assumed = 0;
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    if (!map.above(tile)) continue;
    const std::size_t i = std::size_t(tile);
    (scales_[i] > 0 ? assumed : known) += grey(map.sums[i].irradiance);
  }
  if (!(assumed > 0)) return;
  const double share = map.seen_sky_share();
  const double factor = (share * grey(plane_irradiance) - known) / assumed;
  if (!(factor > 0) || !std::isfinite(factor)) return;
  const std::optional<double> mend = mending(share, factor, assumed >= known, time);
  if (!mend) return;
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    if (!map.above(tile) || scales_[i] <= 0 || map.sums[i].count == 0) continue;
    scale_texels(map.state, map.geometry.start(tile), map.geometry.texels(tile), float(*mend));
    map.sum(tile), map.make_levels(tile);
    changed.push_back(tile);
  }
  std::sort(changed.begin(), changed.end());
  changed.erase(std::unique(changed.begin(), changed.end()), changed.end());
  ++mended_;
}

}  // namespace fastibl
