#include "fastibl/capture/unseen.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/simd.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {
namespace {

// Share by which a source moves before what it stands for follows: far less than what is not known
// there.
constexpr float kMoved = 0.02f;
constexpr float kMovedHalf = 0.005f;  // the same of what stands for half the sphere
constexpr float kMidGrey = 0.5f;      // of the sky before any picture

bool moved(const glm::vec3& from, const glm::vec3& to, float share) {
  const glm::vec3 difference = glm::abs(to - from), limit = share * glm::abs(from);
  return difference.x > limit.x || difference.y > limit.y || difference.z > limit.z;
}

// Where the new source is nearer than the one before; of two as near the one of lower index.
FASTIBL_CLONES void take_nearer(const float* __restrict x, const float* __restrict y,
                                const float* __restrict z, const int* __restrict above, int count,
                                int tile, int* __restrict source, float* __restrict nearness) {
  const float tx = x[tile], ty = y[tile], tz = z[tile];
  const int side = above[tile];
  for (int i = 0; i < count; ++i) {
    const float dot = x[i] * tx + y[i] * ty + z[i] * tz;
    const int nearer =
        (above[i] == side) & ((dot > nearness[i]) | ((dot == nearness[i]) & (tile < source[i])));
    source[i] = nearer ? tile : source[i];
    nearness[i] = nearer ? dot : nearness[i];
  }
}

}  // namespace

UnseenTiles::UnseenTiles(TileGrid grid, float plane_albedo)
    : grid_(grid), plane_albedo_(plane_albedo) {
  for (int tile = 0; tile < grid.count(); ++tile) {
    const FaceRect r = tile_rect(grid, tile);
    const float n = float(grid.size);
    const glm::vec3 d = glm::normalize(
        face_direction(r.face, 0.5f * float(r.x0 + r.x1) / n, 0.5f * float(r.y0 + r.y1) / n));
    x_.push_back(d.x), y_.push_back(d.y), z_.push_back(d.z);
    above_.push_back(d.z >= 0);
  }
  const std::size_t count = std::size_t(grid.count());
  source_.assign(count, -1);
  nearness_.assign(count, -2.0f);
  mean_.assign(count, glm::vec3(0));
  fill_.resize(count);
  for (std::size_t i = 0; i < count; ++i)
    fill_[i] = glm::vec3(above_[i] ? kMidGrey : kMidGrey * plane_albedo);
}

void UnseenTiles::add_source(int tile) {
  take_nearer(x_.data(), y_.data(), z_.data(), above_.data(), grid_.count(), tile, source_.data(),
              nearness_.data());
  source_[std::size_t(tile)] = tile, nearness_[std::size_t(tile)] = 2;
}

void UnseenTiles::fill_half(bool above, glm::vec3 value, std::vector<int>& refilled) {
  for (int tile = 0; tile < grid_.count(); ++tile) {
    glm::vec3& fill = fill_[std::size_t(tile)];
    if (bool(above_[std::size_t(tile)]) != above || !moved(fill, value, kMovedHalf)) continue;
    fill = value;
    refilled.push_back(tile);
  }
}

// A uniform sky that would light the plane as it looks.
glm::vec3 UnseenTiles::sky_without_pictures(const std::vector<TileSums>& sums) const {
  glm::dvec3 flux(0);
  double angle = 0;
  for (std::size_t i = 0; i < sums.size(); ++i)
    if (!above_[i]) flux += sums[i].flux, angle += sums[i].angle;
  return angle > 0 ? glm::vec3(flux / angle / double(plane_albedo_)) : glm::vec3(kMidGrey);
}

void UnseenTiles::update(std::span<const int> changed, const std::vector<TileSums>& sums,
                         const std::vector<double>& tile_projected, std::vector<int>& refilled) {
  bool any = false;
  for (const int tile : changed) {
    const std::size_t i = std::size_t(tile);
    const TileSums& s = sums[i];
    if (s.count == 0) continue;
    const glm::vec3 mean(s.value / double(s.count));
    const bool first = source_[i] != tile;
    if (first) add_source(tile);
    seen_[above_[i]] = true;
    if (!first && !moved(mean_[i], mean, kMoved)) continue;
    mean_[i] = mean;
    any = true;
  }
  for (int tile = 0; any && tile < grid_.count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    const int source = source_[i];
    if (source < 0 || fill_[i] == mean_[std::size_t(source)]) continue;
    fill_[i] = mean_[std::size_t(source)];
    refilled.push_back(tile);
  }
  if (!seen_[1]) fill_half(true, sky_without_pictures(sums), refilled);
  if (!seen_[0]) {
    glm::dvec3 irradiance(0);  // of the plane
    for (std::size_t i = 0; i < sums.size(); ++i)
      if (above_[i])
        irradiance +=
            sums[i].irradiance + (tile_projected[i] - sums[i].projected) * glm::dvec3(fill_[i]);
    fill_half(false, glm::vec3(double(plane_albedo_) / std::numbers::pi * irradiance), refilled);
  }
}

}  // namespace fastibl
