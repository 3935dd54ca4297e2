#include "fastibl/shadow/steady_light.h"

#include <algorithm>

#include "fastibl/core/check.h"
#include "fastibl/scene/methods.h"

namespace fastibl {
namespace {

constexpr double kLargest = 4;             // part, by the mean of all
constexpr double kLeastInUse = 1 / 2.0;    // of the parts
constexpr double kAnotherPlace = 1 / 8.0;  // of the light, moved at once

double weight_of(const LightDirection& d) {
  return std::max(std::max(d.share.x, d.share.y), d.share.z);
}

// How badly directions fit the light: 1 if all count the same, more than 1 if they should be chosen
// anew.
double misfit(const std::vector<LightDirection>& light) {
  double sum = 0, squares = 0, largest = 0;
  for (const LightDirection& d : light) {
    const double w = weight_of(d);
    sum += w, squares += w * w, largest = std::max(largest, w);
  }
  const double n = double(light.size());
  if (!(sum > 0)) return 0;
  // (Σ w)²/Σ w²: this many equal parts would do.
  return std::max(largest * n / sum / kLargest, squares * n / (sum * sum) * kLeastInUse);
}

// Share of the light that has moved from one direction to another.
double moved(const std::vector<LightDirection>& before, const std::vector<LightDirection>& after) {
  glm::dvec3 sum(0);
  for (std::size_t i = 0; i < before.size(); ++i)
    sum += glm::abs(glm::dvec3(after[i].share) - glm::dvec3(before[i].share));
  return 0.5 * std::max(std::max(sum.x, sum.y), sum.z);
}

}  // namespace

SteadyLight::SteadyLight(int count) : count_(count) {
  check(count >= kLeastDirections && count <= kMostDirections, "directions must be from ",
        kLeastDirections, " to ", kMostDirections, ", got ", count);
}

SteadyLight::Set SteadyLight::split(const CubeMap& radiance) const {
  const SkyEnergy sky(radiance, brightest_texel(count_));
  Set set{sky.bright(), split_sky(sky, count_), {}};
  set.light = light_directions(sky, set.parts);
  return set;
}

void SteadyLight::follow(const CubeMap& radiance, Set& set) {
  set.light = light_directions(SkyEnergy(radiance, set.bright), set.parts);
}

bool SteadyLight::same_map(const CubeMap& radiance) {
  const auto versions = radiance.tile_versions();
  if (map_size_ == radiance.size() &&
      std::equal(versions.begin(), versions.end(), map_versions_.begin(), map_versions_.end()))
    return true;
  map_versions_.assign(versions.begin(), versions.end());
  return false;
}

void SteadyLight::mix() {
  directions_ = current_.light;
  if (!next_) return;
  for (LightDirection& d : directions_) d.share *= float(1 - fade_);
  for (LightDirection d : next_->light) {
    d.share *= float(fade_);
    directions_.push_back(d);
  }
}

SteadyLight::Change SteadyLight::update(const CubeMap& radiance) {
  check(radiance.size() > 0, "the radiance map is empty");
  const bool same = same_map(radiance);
  if (same && !next_) return Change::none;
  // Parts belong to one size of map.
  const bool new_size = map_size_ != radiance.size();
  map_size_ = radiance.size();
  double step = 1.0 / kFadeUpdates;
  bool start = current_.parts.empty() || new_size || (no_light_ && !next_);
  if (!same && !start) {
    const std::vector<LightDirection> before = current_.light;
    follow(radiance, current_);
    if (next_) follow(radiance, *next_);
    const double share = moved(before, current_.light);
    step = std::max(step, share / kAnotherPlace);
    start = step >= 1;
  }
  const auto dark = [](const std::vector<LightDirection>& light) {
    return std::all_of(light.begin(), light.end(),
                       [](const LightDirection& d) { return weight_of(d) == 0; });
  };
  if (start) {
    current_ = split(radiance);
    next_.reset();
    no_light_ = dark(current_.light);
    mix();
    return Change::directions;
  }
  no_light_ = dark(current_.light);
  Change change = Change::shares;
  if (!next_ && misfit(current_.light) > 1) {
    Set fresh = split(radiance);
    // Few directions for a hard light may fit no better.
    if (misfit(fresh.light) < 0.7 * misfit(current_.light)) {
      next_ = std::move(fresh);
      fade_ = 0;
      change = Change::directions;
    }
  }
  if (next_) {
    fade_ += step;
    if (fade_ >= 1) {
      current_ = std::move(*next_);
      next_.reset();
      change = Change::directions;
    }
  }
  mix();
  return change;
}

}  // namespace fastibl
