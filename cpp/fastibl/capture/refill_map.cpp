// What a Capture's map holds where no picture has seen.
#include <algorithm>
#include <cmath>

#include "fastibl/capture/capture.h"

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

void Capture::take_changes(const std::vector<int>& changed, int refills) {
  bool all_refills = refills == map_.grid().count();
  std::vector<int> refilled, boosted;
  last_taken_ = time_;
  new_sums_.insert(new_sums_.end(), changed.begin(), changed.end());
  const bool unmatched = prior_ && !prior_->matched();
  if (all_refills || unmatched || ++pictures_ % kPicturesPerFill == 0) {
    if (prior_ && match_prior(refilled)) refills = map_.grid().count(), all_refills = true;
    if (options_.most_boost > 1) boost_lights(boosted);
    unseen_.update(new_sums_, map_.sums, map_.geometry.tile_projected, time_, all_refills,
                   refilled);
    new_sums_.clear();
  }
  const std::uint64_t version = new_tile_version();
  for (const int tile : changed) map_.versions[std::size_t(tile)] = version, refill(tile);
  for (const int tile : boosted) map_.versions[std::size_t(tile)] = version, map_.make_levels(tile);
  for (const int tile : refilled) stale_fill_[std::size_t(tile)] = 1;
  int small_refills = all_refills ? refills : refills / kSmallLater;
  for (int i = 0; i < map_.grid().count() && refills > 0; ++i) {
    next_refill_ = (next_refill_ + 1) % map_.grid().count();
    if (!stale_fill_[std::size_t(next_refill_)]) continue;
    const bool small = is_small_refill(next_refill_);
    if ((small && small_refills == 0) || !refill(next_refill_)) continue;
    map_.versions[std::size_t(next_refill_)] = version;
    --refills, small_refills -= small;
  }
}

bool Capture::is_small_refill(int tile) const {
  const glm::vec3 from = filled_[std::size_t(tile)];
  const glm::vec3 step = glm::abs(unseen_.middle(tile) - from), limit = kSmallRefill * from;
  return step.x <= limit.x && step.y <= limit.y && step.z <= limit.z;
}

int Capture::refills_after(double time, const Camera& camera) const {
  // Pictures without times of their own are stills, not a film.
  const bool still = time == time_ && last_camera_ == camera;
  const double share =
      still ? 1 : std::clamp((time - last_taken_) / kRefillTime, kLeastRefill, 1.0);
  return int(share * map_.grid().count());
}

bool Capture::refill(int tile) {
  const FaceRect r = tile_rect(map_.grid(), tile);
  const int seen = map_.sums[std::size_t(tile)].count;
  stale_fill_[std::size_t(tile)] = 0;
  if (seen == r.texels()) return false;
  if (has_prior(tile)) {
    refill_from_prior(tile);
    return true;
  }
  const FillPatch fill = unseen_.fill(tile);
  filled_[std::size_t(tile)] = fill.mean();
  const std::size_t start = map_.geometry.start(tile);
  float* const texels[3] = {&map_.state.value[0][start], &map_.state.value[1][start],
                            &map_.state.value[2][start]};
  lay_patch(fill, r, seen > 0 ? map_.state.last_seen.texels(tile) : nullptr, texels);
  if (seen > 0)
    map_.make_levels(tile);
  else
    map_.pyramids.make(tile, texels);
  return true;
}

void Capture::refill_from_prior(int tile) {
  const FaceRect r = tile_rect(map_.grid(), tile);
  const std::size_t start = map_.geometry.start(tile);
  const float* angles = map_.geometry.angles(tile);
  glm::dvec3 flux(0);
  double angle = 0;
  for (int k = 0; k < r.texels(); ++k) {
    if (map_.state.last_seen.at(tile, k) > kNever) continue;
    const glm::vec3 value = prior_->texel(tile, k);
    for (int c = 0; c < 3; ++c) map_.state.value[c][start + std::size_t(k)] = value[c];
    flux += double(angles[k]) * glm::dvec3(value), angle += double(angles[k]);
  }
  filled_[std::size_t(tile)] = glm::vec3(flux / angle);
  map_.make_levels(tile);
}

bool Capture::match_prior(std::vector<int>& refilled) {
  const float moved = prior_->match(map_.sums, map_.geometry.tile_angle,
                                    map_.geometry.tile_projected, sky_, meter_.irradiance());
  if (!(moved > 0)) return false;
  for (const int tile : sky_) {
    unseen_.give(tile, prior_->mean(tile));
    if (!map_.was_seen_whole(tile)) refilled.push_back(tile);
  }
  return moved > kOtherScale;
}

}  // namespace fastibl
