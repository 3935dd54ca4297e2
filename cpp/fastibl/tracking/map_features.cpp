#include "fastibl/tracking/map_features.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace fastibl {
namespace {

// Relative variance of a texel over RGB above which it is not known: lower bounds have about 1.
constexpr float kMostVariance = 0.1f;
constexpr float kLeastGradient = 0.03f;  // of the light, from one texel to the next
constexpr double kDark = 0.001;          // of the mean radiance

}  // namespace

glm::vec3 tangent_gradient(const glm::vec3& u, const glm::vec3& v, float lu, float lv) {
  const float uu = glm::dot(u, u), uv = glm::dot(u, v), vv = glm::dot(v, v);
  const float inverse = 1 / (uu * vv - uv * uv);
  return ((vv * lu - uv * lv) * inverse) * u + ((uu * lv - uv * lu) * inverse) * v;
}

void MapFeatures::start(const Environment& environment) {
  grid_ = environment.radiance.tiles();
  versions_.assign(std::size_t(grid_.count()), 0);
  variance_.assign(6 * std::size_t(grid_.size) * std::size_t(grid_.size), -1.0f);
  tiles_.assign(std::size_t(grid_.count()), Tile{});
  for (int t = 0; t < grid_.count(); ++t) tiles_[std::size_t(t)].cone = tile_cone(grid_, t);
}

bool MapFeatures::known(int level, int face, int x, int y) const {
  const int n = grid_.size, step = 1 << level;
  if (x < 0 || y < 0 || (x + 1) * step > n || (y + 1) * step > n) return false;
  for (int j = y * step; j < (y + 1) * step; ++j)
    for (int i = x * step; i < (x + 1) * step; ++i)
      if (variance_[(std::size_t(face) * std::size_t(n) + std::size_t(j)) * std::size_t(n) +
                    std::size_t(i)] < 0)
        return false;
  return true;
}

void MapFeatures::find_known(const Environment& environment, int t, float drift) {
  const FaceRect r = tile_rect(grid_, t);
  const std::size_t n = std::size_t(grid_.size),
                    start = std::size_t(t) * std::size_t(grid_.stride());
  Tile& tile = tiles_[std::size_t(t)];
  const bool before = tile.known;
  tile.known = false;
  int k = 0;
  for (int y = r.y0; y < r.y1; ++y)
    for (int x = r.x0; x < r.x1; ++x, ++k) {
      float variance = 0;
      if (!environment.last_seen.empty()) {
        const double seen = environment.last_seen.at(t, k);
        variance =
            std::bit_cast<float>(std::uint32_t(environment.variance[start + std::size_t(k)]) << 16);
        if (!(seen > -1e300 && variance < kMostVariance)) variance = -1;
      }
      tile.known |= variance >= 0;
      variance_[(std::size_t(r.face) * n + std::size_t(y)) * n + std::size_t(x)] = variance;
    }
  if (tile.known && !before) tile.drift = drift;
}

void MapFeatures::find_level(const Environment& environment, int t, int level) {
  Tile& tile = tiles_[std::size_t(t)];
  std::vector<MapFeature>& features = tile.features[level];
  features.clear();
  if (!tile.known) return;
  const FaceRect whole = tile_rect(grid_, t);
  const int step = 1 << level, n = grid_.size >> level;
  const CubeLevel& map = environment.radiance.level(level);
  struct Found {
    float strength;
    int x, y;
  };
  std::vector<Found> found;
  for (int y = whole.y0 / step; y < whole.y1 / step; ++y)
    for (int x = whole.x0 / step; x < whole.x1 / step; ++x) {
      if (!known(level, whole.face, x, y) || !known(level, whole.face, x - 1, y) ||
          !known(level, whole.face, x + 1, y) || !known(level, whole.face, x, y - 1) ||
          !known(level, whole.face, x, y + 1))
        continue;
      const float light = map.texel(whole.face, x, y).y + float(dark_);
      const float lu = map.texel(whole.face, x + 1, y).y - map.texel(whole.face, x - 1, y).y;
      const float lv = map.texel(whole.face, x, y + 1).y - map.texel(whole.face, x, y - 1).y;
      const float strength = (std::abs(lu) + std::abs(lv)) / (2 * light);
      if (strength < kLeastGradient) continue;
      found.push_back({strength, x, y});
    }
  const std::size_t most = level == 0 ? kPerTile : kPerTile1;
  if (found.size() > most) {
    std::partial_sort(found.begin(), found.begin() + most, found.end(),
                      [](const Found& a, const Found& b) { return a.strength > b.strength; });
    found.resize(most);
  }
  for (const Found& place : found) {
    const int x = place.x, y = place.y, f = whole.face;
    const glm::vec3 ray = texel_direction(f, x, y, n), d = glm::normalize(ray);
    if (!(d.z > 0)) continue;
    // Derivatives of the unit direction by a step to the next texel.
    const float shrink = 1 / glm::length(ray);
    const glm::vec3 right = texel_direction(f, x + 1, y, n) - ray,
                    down = texel_direction(f, x, y + 1, n) - ray;
    const glm::vec3 u = shrink * (right - glm::dot(right, d) * d),
                    v = shrink * (down - glm::dot(down, d) * d);
    const float lu = 0.5f * (map.texel(f, x + 1, y).y - map.texel(f, x - 1, y).y),
                lv = 0.5f * (map.texel(f, x, y + 1).y - map.texel(f, x, y - 1).y);
    const std::size_t fine = (std::size_t(f) * std::size_t(grid_.size) + std::size_t(y * step)) *
                                 std::size_t(grid_.size) +
                             std::size_t(x * step);
    features.push_back({d, glm::cross(d, tangent_gradient(u, v, lu, lv)), map.texel(f, x, y).y,
                        variance_[fine], 0.5f * (glm::length(u) + glm::length(v)), tile.drift, 0});
  }
}

void MapFeatures::find_features(const Environment& environment, int t) {
  const bool halves = (grid_.size & 3) == 0;  // coarse texels are made of whole fine ones
  for (int level = 0; level < kLevels; ++level) {
    if (level == 0 || (halves && level < environment.radiance.level_count()))
      find_level(environment, t, level);
    else
      tiles_[std::size_t(t)].features[level].clear();
  }
}

void MapFeatures::update(const Environment& environment, double drift) {
  const CubeMap& map = environment.radiance;
  if (versions_.empty() || grid_.size != map.size()) start(environment);
  const glm::vec3 mean = map.level(map.level_count() - 1).sample(glm::vec3(0, 0, 1));
  dark_ = kDark * std::max(1e-12, double(mean.y));
  std::vector<int> changed;
  for (int t = 0; t < grid_.count(); ++t)
    if (versions_[std::size_t(t)] != map.tile_version(t)) {
      versions_[std::size_t(t)] = map.tile_version(t);
      if (tiles_[std::size_t(t)].cone.middle.z > 0) changed.push_back(t);
    }
  for (const int t : changed) find_known(environment, t, float(drift));
  for (const int t : changed) find_features(environment, t);
}

}  // namespace fastibl
