#include "fastibl/capture/prior_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fastibl {
namespace {

constexpr double kNearlyWhole = 0.9;    // of a tile's solid angle
constexpr std::size_t kLeastTiles = 8;  // that tell a brightness; fewer may all show what changed
constexpr float kMoved = 0.02f;         // share of the brightness that is worth new texels

}  // namespace

PriorMap::PriorMap(std::shared_ptr<const CubeMap> map, TileGrid grid)
    : map_(std::move(map)),
      grid_(grid),
      stride_(std::size_t(grid.stride())),
      texels_(std::size_t(grid.count()) * stride_),
      means_(std::size_t(grid.count())) {
  read();
}

void PriorMap::turn(const glm::dmat3& new_from_old) {
  now_from_then_ = new_from_old * now_from_then_;
  read();
}

void PriorMap::read() {
  const CubeMap& map = *map_;
  int level = 0;
  while (level + 1 < map.level_count() && map.level(level).size() > grid_.size) ++level;
  const CubeLevel& source = map.level(level);
  const bool same = source.size() == grid_.size && now_from_then_ == glm::dmat3(1);
  const glm::mat3 then_from_now(glm::transpose(now_from_then_));
  const std::vector<double> angles = texel_solid_angles(grid_.size);
  for (int tile = 0; tile < grid_.count(); ++tile) {
    const FaceRect r = tile_rect(grid_, tile);
    glm::dvec3 flux(0);
    double angle = 0;
    std::size_t k = std::size_t(tile) * stride_;
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x, ++k) {
        texels_[k] = same ? source.texel(r.face, x, y)
                          : map.sample(then_from_now * texel_direction(r.face, x, y, grid_.size),
                                       float(level));
        const double a = angles[std::size_t(y) * std::size_t(grid_.size) + std::size_t(x)];
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
    bool dark = true;  // in this channel, which then tells nothing
    for (const int tile : sky) {
      const std::size_t i = std::size_t(tile);
      dark &= !(means_[i][c] > 0);
      const bool whole = sums[i].angle >= kNearlyWhole * tile_angle[i];
      if (!whole || sums[i].bound_angle > 0 || !(means_[i][c] > 0)) continue;
      const float ratio = float(sums[i].flux[c] / sums[i].angle) / means_[i][c];
      if (std::isfinite(ratio)) ratios.push_back(ratio);
    }
    if (dark) continue;
    enough = enough && ratios.size() >= kLeastTiles;
    if (!enough) break;
    const auto middle = ratios.begin() + std::ptrdiff_t(ratios.size() / 2);
    std::nth_element(ratios.begin(), middle, ratios.end());
    gain[c] = *middle;
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
  float most = 0;
  for (int c = 0; c < 3; ++c)
    if (gain[c] != gain_[c]) most = std::max(most, std::abs(gain[c] - gain_[c]) / gain_[c]);
  if (!(most > kMoved)) return 0;
  gain_ = gain;
  return most;
}

}  // namespace fastibl
