// The scale of cameras that tell no exposure, found from the board's white in another one's
// pictures.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/capture/capture.h"

namespace fastibl {
namespace {

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

double grey(const glm::dvec3& light) { return (light.x + light.y + light.z) / 3; }

}  // namespace

std::optional<double> Capture::assumed_exposure(const Picture& picture,
                                                const Camera& camera) const {
  if (!plane_irradiance_) return std::nullopt;
  const ByteResponse bytes(camera.response);
  const PixelReader pixels(picture, camera.response, bytes);
  constexpr int kAcross = 32;
  double sum = 0;
  for (int j = 0; j < kAcross; ++j)
    for (int i = 0; i < kAcross; ++i) {
      const glm::vec3 linear =
          pixels.linear(i * picture.width / kAcross, j * picture.height / kAcross);
      sum += double(linear.x + linear.y + linear.z) / (3 * kAcross * kAcross);
    }
  const double radiance = grey(*plane_irradiance_) / std::numbers::pi;
  const double exposure = sum / (radiance * camera.gain);
  if (!(exposure > 0) || !std::isfinite(exposure)) return std::nullopt;
  return exposure;
}

double Capture::scale_error() const {
  if (!cameras_.any_assumed()) return 0;
  if (!plane_irradiance_) return 1;
  const glm::dvec3 sky =
      map_.seen_sky_irradiance() + unseen_.sky_irradiance(map_.sums, map_.geometry.tile_projected);
  const double ratio = grey(sky) / grey(*plane_irradiance_);
  return std::isfinite(ratio) ? std::max(std::abs(ratio - 1), kMeterDeviation) : 1;
}

void Capture::note_scales(const std::vector<int>& tiles, int assumed_of, bool untold) {
  for (const int tile : tiles) {
    int& scale = scales_[std::size_t(tile)];
    if (scale == kNoScale)
      scale = assumed_of > 0 ? assumed_of : kOwnScale;
    else if (!untold)
      scale = kOwnScale;
  }
}

void Capture::know_scale(int first) {
  std::replace(scales_.begin(), scales_.end(), first, kOwnScale);
}

// The unseen sky is taken to be as bright as the seen part. The more was seen, the better the scale
// is known, so the white is asked again whenever more was seen. As the same part is seen, what
// changes is the light, which pictures of cameras that tell no exposure do not show.
std::optional<double> Capture::mending(double share, double factor, bool follow) {
  if (scaled_at_ <= kAllSeen && share >= kLeastSeen &&
      1 - share <= kLessUnseen * (1 - scaled_at_)) {
    scaled_at_ = share;
    const bool good = std::abs(std::log(factor)) <= kGuess + share * (kGood - kGuess);
    balance_ = Balance{good ? factor : 1, share, time_};
    return good ? std::nullopt : std::optional(factor);
  }
  if (!follow || !balance_ || std::abs(share - balance_->share) > kSameShare)
    balance_ = Balance{factor, share, time_};
  const double drift = factor / balance_->factor;
  if (std::abs(std::log(drift)) <= kDrift) balance_->since = time_;
  if (time_ - balance_->since < kDrifts) return std::nullopt;
  balance_->since = time_;
  return drift;
}

void Capture::mend_scale(std::vector<int>& changed) {
  if (prior_ || map_.boost.any()) return;
  double known = 0, assumed = 0, seen = 0, sky = 0;
  for (int tile = 0; tile < map_.grid().count(); ++tile) {
    if (!map_.above(tile)) continue;
    const std::size_t i = std::size_t(tile);
    const TileSums& sums = map_.sums[i];
    sky += map_.geometry.tile_projected[i], seen += sums.projected;
    (scales_[i] > 0 ? assumed : known) += grey(sums.irradiance);
  }
  if (!(assumed > 0)) return;
  const double share = seen / sky;
  const double factor = (share * grey(*plane_irradiance_) - known) / assumed;
  if (!(factor > 0) || !std::isfinite(factor)) return;
  const std::optional<double> mend = mending(share, factor, assumed >= known);
  if (!mend) return;
  const std::size_t stride = std::size_t(map_.grid().stride());
  for (int tile = 0; tile < map_.grid().count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    if (!map_.above(tile) || scales_[i] <= 0 || map_.sums[i].count == 0) continue;
    scale_texels(map_.state, i * stride, map_.geometry.texels(tile), float(*mend));
    map_.sum(tile);
    changed.push_back(tile);
  }
  std::sort(changed.begin(), changed.end());
  changed.erase(std::unique(changed.begin(), changed.end()), changed.end());
  ++mended_;
}

}  // namespace fastibl
