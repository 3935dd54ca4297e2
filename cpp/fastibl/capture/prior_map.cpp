#include "fastibl/capture/prior_map.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kNearlyWhole = 0.9;    // of a tile's solid angle
constexpr std::size_t kLeastTiles = 8;  // that tell a brightness; fewer may all show what changed
constexpr float kMoved = 0.02f;         // share of the brightness that is worth new texels

}  // namespace

PriorMap::PriorMap(const CubeMap& map, TileGrid grid)
    : stride_(std::size_t(grid.stride())),
      texels_(std::size_t(grid.count()) * stride_),
      means_(std::size_t(grid.count())) {
  int level = 0;
  while (level + 1 < map.level_count() && map.level(level).size() > grid.size) ++level;
  const CubeLevel& source = map.level(level);
  const bool same = source.size() == grid.size;
  const std::vector<double> angles = texel_solid_angles(grid.size);
  for (int tile = 0; tile < grid.count(); ++tile) {
    const FaceRect r = tile_rect(grid, tile);
    glm::dvec3 flux(0);
    double angle = 0;
    std::size_t k = std::size_t(tile) * stride_;
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x, ++k) {
        texels_[k] = same ? source.texel(r.face, x, y)
                          : map.sample(texel_direction(r.face, x, y, grid.size), float(level));
        const double a = angles[std::size_t(y) * std::size_t(grid.size) + std::size_t(x)];
        flux += a * glm::dvec3(texels_[k]), angle += a;
      }
    means_[std::size_t(tile)] = glm::vec3(flux / angle);
  }
}

float PriorMap::match(const std::vector<TileSums>& sums, std::span<const double> tile_angle,
                      std::span<const double> tile_projected, std::span<const int> sky,
                      const std::optional<glm::dvec3>& plane_irradiance) {
  glm::vec3 gain = gain_;
  bool enough = true;
  for (int c = 0; c < 3; ++c) {
    std::vector<float> ratios;
    for (const int tile : sky) {
      const std::size_t i = std::size_t(tile);
      const bool whole = sums[i].angle >= kNearlyWhole * tile_angle[i];
      if (!whole || sums[i].bound_angle > 0 || !(means_[i][c] > 0)) continue;
      const float ratio = float(sums[i].flux[c] / sums[i].angle) / means_[i][c];
      if (std::isfinite(ratio)) ratios.push_back(ratio);
    }
    enough = enough && ratios.size() >= kLeastTiles;
    if (!enough) break;
    const auto middle = ratios.begin() + std::ptrdiff_t(ratios.size() / 2);
    std::nth_element(ratios.begin(), middle, ratios.end());
    if (*middle > 0) gain[c] = *middle;
  }
  if (!enough) {
    if (!plane_irradiance || matched_ == Matched::by_tiles) return 0;
    gain = gain_;
    glm::dvec3 own(0);
    for (const int tile : sky)
      own += tile_projected[std::size_t(tile)] * glm::dvec3(means_[std::size_t(tile)]);
    for (int c = 0; c < 3; ++c) {
      const float ratio = float((*plane_irradiance)[c] / own[c]);
      if (std::isfinite(ratio) && ratio > 0) gain[c] = ratio;
    }
  }
  matched_ = enough ? Matched::by_tiles : Matched::by_plane;
  const glm::vec3 change = glm::abs(gain - gain_) / gain_;
  const float most = std::max({change.x, change.y, change.z});
  if (!(most > kMoved)) return 0;
  gain_ = gain;
  return most;
}

}  // namespace fastibl
