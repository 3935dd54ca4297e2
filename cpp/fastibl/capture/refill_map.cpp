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
  bool all_refills = refills == grid_.count();
  std::vector<int> refilled, boosted;
  last_taken_ = time_;
  new_sums_.insert(new_sums_.end(), changed.begin(), changed.end());
  const bool unmatched = prior_ && !prior_->matched();
  if (all_refills || unmatched || ++pictures_ % kPicturesPerFill == 0) {
    if (prior_ && match_prior(refilled)) refills = grid_.count(), all_refills = true;
    if (options_.most_boost > 1) boost_lights(boosted);
    unseen_.update(new_sums_, sums_, tile_projected_, time_, all_refills, refilled);
    new_sums_.clear();
  }
  const std::uint64_t version = new_tile_version();
  for (const int tile : changed) versions_[std::size_t(tile)] = version, refill(tile);
  for (const int tile : boosted) versions_[std::size_t(tile)] = version, make_levels(tile);
  for (const int tile : refilled) stale_fill_[std::size_t(tile)] = 1;
  int small_refills = all_refills ? refills : refills / kSmallLater;
  for (int i = 0; i < grid_.count() && refills > 0; ++i) {
    next_refill_ = (next_refill_ + 1) % grid_.count();
    if (!stale_fill_[std::size_t(next_refill_)]) continue;
    const bool small = is_small_refill(next_refill_);
    if ((small && small_refills == 0) || !refill(next_refill_)) continue;
    versions_[std::size_t(next_refill_)] = version;
    --refills, small_refills -= small;
  }
}

bool Capture::is_small_refill(int tile) const {
  const glm::vec3 from = filled_[std::size_t(tile)];
  const glm::vec3 step = glm::abs(unseen_.middle(tile) - from), limit = kSmallRefill * from;
  return step.x <= limit.x && step.y <= limit.y && step.z <= limit.z;
}

void Capture::make_levels(int tile) {
  std::vector<float> room;
  pyramids_.make(tile, shown_texels(tile, room).data());
  quiet_.place_probes(tile, pyramids_);
}

int Capture::refills_after(double time, const Camera& camera) const {
  // Pictures without times of their own are stills, not a film.
  const bool still = time == time_ && last_camera_ == camera;
  const double share =
      still ? 1 : std::clamp((time - last_taken_) / kRefillTime, kLeastRefill, 1.0);
  return int(share * grid_.count());
}

bool Capture::refill(int tile) {
  const FaceRect r = tile_rect(grid_, tile);
  const int seen = sums_[std::size_t(tile)].count;
  stale_fill_[std::size_t(tile)] = 0;
  if (seen == r.texels()) return false;
  if (has_prior(tile)) {
    refill_from_prior(tile);
    return true;
  }
  const FillPatch fill = unseen_.fill(tile);
  filled_[std::size_t(tile)] = fill.mean();
  const std::size_t start = std::size_t(tile) * std::size_t(grid_.stride());
  float* const texels[3] = {&state_.value[0][start], &state_.value[1][start],
                            &state_.value[2][start]};
  lay_patch(fill, r, seen > 0 ? state_.last_seen.texels(tile) : nullptr, texels);
  if (seen > 0)
    make_levels(tile);
  else
    pyramids_.make(tile, texels);
  return true;
}

void Capture::refill_from_prior(int tile) {
  const FaceRect r = tile_rect(grid_, tile);
  const std::size_t start = std::size_t(tile) * std::size_t(grid_.stride());
  const float* angles = angles_of(tile);
  glm::dvec3 flux(0);
  double angle = 0;
  for (int k = 0; k < r.texels(); ++k) {
    if (state_.last_seen.at(tile, k) > kNever) continue;
    const glm::vec3 value = prior_->texel(tile, k);
    for (int c = 0; c < 3; ++c) state_.value[c][start + std::size_t(k)] = value[c];
    flux += double(angles[k]) * glm::dvec3(value), angle += double(angles[k]);
  }
  filled_[std::size_t(tile)] = glm::vec3(flux / angle);
  make_levels(tile);
}

bool Capture::match_prior(std::vector<int>& refilled) {
  const float moved = prior_->match(sums_, tile_angle_, tile_projected_, sky_, plane_irradiance_);
  if (!(moved > 0)) return false;
  for (const int tile : sky_) {
    unseen_.give(tile, prior_->mean(tile));
    if (!was_seen_whole(tile)) refilled.push_back(tile);
  }
  return moved > kOtherScale;
}

}  // namespace fastibl
