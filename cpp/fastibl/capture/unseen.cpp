#include "fastibl/capture/unseen.h"

#include <algorithm>

#include "fastibl/core/simd.h"
#include "fastibl/scene/tile_cone.h"

namespace fastibl {
namespace {

// Share by which a fill may be wrong before it is made anew: far less than what is not known there.
constexpr float kMoved = 0.02f;
constexpr float kMovedHalf = 0.005f;  // the same for what stands for half the sphere
constexpr float kMidGrey = 0.5f;      // of the sky before any picture
constexpr int kSlices = 4;            // calls in which all tiles are looked at once
// Least trust in a tile, relative to one that was seen for kSettled seconds in every exposure.
constexpr float kLeastTrust = 0.02f;
constexpr double kSettled = 0.5;
constexpr float kClippedTrust = 1e-3f;  // trust in what is only a lower bound
// No tile stands for more than this times the mean of what was seen on its side. On seven maps that
// were swept in part, the irradiance is wrong by 0.31 instead of 0.39 on average.
constexpr float kMostOfMean = 8.0f;
constexpr float kDarkest = 0.05f, kBrightest = 4;  // bounds of brightness_
// Standard deviation, as a share of the plane's light, of what an unseen sky may give besides what
// was seen of it.
constexpr double kBesides = 0.3;
constexpr float kNear2 = 0.01f;  // squared chord: closer than this, sources count alike
constexpr int kPartial = 16;     // sums side by side, in the same order on every processor

bool moved(const glm::vec3& from, const glm::vec3& to, float share) {
  const glm::vec3 difference = glm::abs(to - from), limit = share * glm::abs(from);
  return difference.x > limit.x || difference.y > limit.y || difference.z > limit.z;
}

// The unseen part of a tile's projected solid angle. Float sums may exceed the whole by their
// rounding, and light of the rest would be negative.
double unseen_part(double projected, const TileSums& sums) {
  return std::max(0.0, projected - sums.projected);
}

// Sums of weight / (|d − source|² + kNear2)⁴, and of that times the value.
template <typename V>
FASTIBL_INLINE void sum_nearness_by(const float* const* from, int count, const float* d,
                                    float* __restrict total) {
  for (int k = 0; k < 4; ++k) total[k] = 0;
  for (int part = 0; part < kPartial; part += kFloatsIn<V>) {
    V sums[4] = {};
    for (int i = part; i < count; i += kPartial) {
      V at[7];
      for (int k = 0; k < 7; ++k) at[k] = floats_at<V>(from[k] + i);
      const V dot = at[0] * d[0] + at[1] * d[1] + at[2] * d[2];
      // The largest is 1, so that eighth powers of the rest do not overflow.
      const V near = kNear2 / ((2 + kNear2) - 2 * dot), near2 = near * near;
      const V weight = at[3] * (near2 * near2);
      sums[0] += weight;
      for (int c = 0; c < 3; ++c) sums[1 + c] += weight * at[4 + c];
    }
    for (int k = 0; k < 4; ++k) add_each(sums[k], total[k]);
  }
}
FASTIBL_BY_WIDTH(void sum_nearness(const float* const* from, int count, const float* d,
                                   float* total),
                 sum_nearness_by<V>(from, count, d, total))

}  // namespace

UnseenTiles::UnseenTiles(TileGrid grid, float plane_albedo)
    : grid_(grid), meetings_(grid), plane_albedo_(plane_albedo) {
  for (int tile = 0; tile < grid.count(); ++tile) {
    const glm::vec3 d = tile_cone(grid, tile).middle;
    x_.push_back(d.x), y_.push_back(d.y), z_.push_back(d.z);
    above_.push_back(d.z >= 0);
  }
  const std::size_t count = std::size_t(grid.count());
  first_seen_.assign(count, kNever), open_.assign(count, 1);
  fill_.resize(count);
  for (std::size_t i = 0; i < count; ++i)
    fill_[i] = glm::vec3(above_[i] ? kMidGrey : kMidGrey * plane_albedo);
}

UnseenTiles::Sources UnseenTiles::sources(bool above, const std::vector<TileSums>& sums,
                                          double time) const {
  std::vector<int> tiles;
  glm::dvec3 sum(0);
  double weights = 0;
  // Solid angle and radiance of a tile, in which bounds hardly count.
  const auto open_angle = [&](std::size_t i) {
    return sums[i].angle - (1 - kClippedTrust) * sums[i].bound_angle;
  };
  const auto radiance = [&](std::size_t i) {
    const glm::dvec3& flux = sums[i].flux;
    const double all = std::max(flux.x + flux.y + flux.z, 1e-300);
    return std::max(0.0, 1 - (1 - kClippedTrust) * sums[i].bound_flux / all) / open_angle(i) * flux;
  };
  const auto trust = [&](std::size_t i) {
    return open_angle(i) * std::clamp((time - first_seen_[i]) / kSettled, double(kLeastTrust), 1.0);
  };
  for (int tile = 0; tile < grid_.count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    if (bool(above_[i]) != above || sums[i].count == 0) continue;
    tiles.push_back(tile);
    const double weight = trust(i);
    sum += weight * radiance(i), weights += weight;
  }
  const glm::dvec3 mean = sum / std::max(weights, 1e-300);
  const double most = double(kMostOfMean) * (mean.x + mean.y + mean.z);
  const std::size_t padded = (tiles.size() + kPartial - 1) / kPartial * kPartial;
  Sources out;
  for (std::vector<float>* v :
       {&out.x, &out.y, &out.z, &out.weight, &out.value[0], &out.value[1], &out.value[2]})
    v->assign(padded, 0.0f);
  for (std::size_t k = 0; k < tiles.size(); ++k) {
    const std::size_t i = std::size_t(tiles[k]);
    const glm::dvec3 value = radiance(i);
    const double all = value.x + value.y + value.z, scale = all > most ? most / all : 1;
    out.x[k] = x_[i], out.y[k] = y_[i], out.z[k] = z_[i];
    out.weight[k] = float(trust(i) / std::max(weights, 1e-300));
    for (int c = 0; c < 3; ++c) out.value[c][k] = float(scale * value[c]);
  }
  return out;
}

void UnseenTiles::interpolate(bool above, const Sources& from, bool first, bool at_once,
                              const std::vector<TileSums>& sums, std::vector<int>& refilled) {
  const float* const arrays[7] = {from.x.data(),       from.y.data(),        from.z.data(),
                                  from.weight.data(),  from.value[0].data(), from.value[1].data(),
                                  from.value[2].data()};
  const int step = first || at_once ? 1 : kSlices;
  for (int tile = calls_ % step; tile < grid_.count(); tile += step) {
    const std::size_t i = std::size_t(tile);
    if (bool(above_[i]) != above || sums[i].count == tile_rect(grid_, tile).texels()) continue;
    const float d[3] = {x_[i], y_[i], z_[i]};
    float total[4];
    sum_nearness(arrays, int(from.x.size()), d, total);
    const glm::vec3 value = glm::vec3(total[1], total[2], total[3]) / std::max(total[0], 1e-37f);
    if (!first && !moved(fill_[i], value, kMoved)) continue;
    fill_[i] = value;
    append_with_neighbours(tile, refilled);
  }
}

FillPatch UnseenTiles::fill(int tile) const {
  const glm::vec3 own = middle(tile);
  FillPatch out;
  out.values.fill(own);
  if (given_sky_ && above_[std::size_t(tile)]) return out;
  for (std::size_t k = 0; k < out.values.size(); ++k) {
    glm::vec3 rest(0);
    int count = 0;
    for (const int other : meetings_.at(tile, int(k))) {
      const std::size_t i = std::size_t(other);
      if (above_[i] != above_[std::size_t(tile)] || !(open_[i] || other == tile)) continue;
      rest += middle(other) - own, ++count;
    }
    out.values[k] += rest / float(count);
  }
  return out;
}

void UnseenTiles::append_with_neighbours(int tile, std::vector<int>& refilled) const {
  refilled.push_back(tile);
  for (const int corner : {0, 2, 6, 8})
    for (const int other : meetings_.at(tile, corner))
      if (other != tile && open_[std::size_t(other)]) refilled.push_back(other);
}

void UnseenTiles::fill_half(bool above, glm::vec3 value, std::vector<int>& refilled) {
  for (int tile = 0; tile < grid_.count(); ++tile) {
    glm::vec3& fill = fill_[std::size_t(tile)];
    if (bool(above_[std::size_t(tile)]) != above || !moved(fill, value, kMovedHalf)) continue;
    fill = value;
    refilled.push_back(tile);
  }
}

void UnseenTiles::find_brightness(const std::vector<TileSums>& sums,
                                  const std::vector<double>& tile_projected,
                                  std::vector<int>& refilled) {
  if (!plane_ || given_sky_) return;
  glm::dvec3 seen(0);    // irradiance of the plane
  double projected = 0;  // projected solid angle of what was not
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (!above_[i]) continue;
    seen += sums[i].irradiance, projected += unseen_part(tile_projected[i], sums[i]);
  }
  const glm::dvec3 unseen = sky_irradiance(sums, tile_projected);
  glm::vec3 brightness(1), besides(0);
  for (int c = 0; c < 3 && projected > 0; ++c) {
    const double unsure = plane_deviation_[c],
                 other = kBesides * projected / std::numbers::pi * (*plane_)[c],
                 variance = unseen[c] * unseen[c] + other * other;
    const double missing = (*plane_)[c] - seen[c] - unseen[c];
    const double is = unseen[c] + missing * variance / (variance + unsure * unsure);
    const double least = kDarkest * unseen[c], most = kBrightest * unseen[c];
    if (unseen[c] > 0) brightness[c] = float(std::clamp(is, least, most) / unseen[c]);
    besides[c] = float(std::max(0.0, is - most) / projected);
  }
  if (!moved(brightness_, brightness, kMoved) && !moved(besides_, besides, kMoved)) return;
  brightness_ = brightness, besides_ = besides;
  for (int tile = 0; tile < grid_.count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    if (above_[i] && sums[i].count < tile_rect(grid_, tile).texels()) refilled.push_back(tile);
  }
}

glm::dvec3 UnseenTiles::sky_irradiance(const std::vector<TileSums>& sums,
                                       const std::vector<double>& tile_projected) const {
  glm::dvec3 out(0);
  for (std::size_t i = 0; i < sums.size(); ++i)
    if (above_[i]) out += unseen_part(tile_projected[i], sums[i]) * glm::dvec3(fill_[i]);
  return out;
}

// The uniform sky that would light the plane as it looks.
glm::vec3 UnseenTiles::sky_without_pictures(const std::vector<TileSums>& sums) const {
  glm::dvec3 flux(0);
  double angle = 0;
  for (std::size_t i = 0; i < sums.size(); ++i)
    if (!above_[i]) flux += sums[i].flux, angle += sums[i].angle;
  return angle > 0 ? glm::vec3(flux / angle / double(plane_albedo_)) : glm::vec3(kMidGrey);
}

void UnseenTiles::update(std::span<const int> changed, const std::vector<TileSums>& sums,
                         const std::vector<double>& tile_projected, double time, bool at_once,
                         std::vector<int>& refilled) {
  const bool had[2] = {seen_[0], seen_[1]};
  for (const int tile : changed) {
    const std::size_t i = std::size_t(tile);
    open_[i] = sums[i].count < tile_rect(grid_, tile).texels();
    if (sums[i].count == 0) continue;
    seen_[above_[i]] = true;
    if (first_seen_[i] == kNever) first_seen_[i] = time;
  }
  ++calls_;
  for (const int half : {0, 1})
    if (seen_[half] && !changed.empty() && !(half && given_sky_))
      interpolate(half, sources(half, sums, time), !had[half], at_once, sums, refilled);
  if (!seen_[1] && !given_sky_) fill_half(true, sky_without_pictures(sums), refilled);
  find_brightness(sums, tile_projected, refilled);
  if (!seen_[0]) {
    glm::dvec3 irradiance(0);  // of the plane
    for (std::size_t i = 0; i < sums.size(); ++i)
      if (above_[i])
        irradiance += sums[i].irradiance +
                      unseen_part(tile_projected[i], sums[i]) * glm::dvec3(middle(int(i)));
    fill_half(false, glm::vec3(double(plane_albedo_) / std::numbers::pi * irradiance), refilled);
  }
}

}  // namespace fastibl
