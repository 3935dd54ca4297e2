#include "fastibl/scene/environment.h"

#include <bit>
#include <limits>
#include <utility>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

// f(tile, texel of the tile) of every texel, packed as the faces are.
template <typename F>
std::vector<float> by_face(TileGrid grid, F&& f) {
  const std::size_t n = std::size_t(grid.size);
  std::vector<float> out(6 * n * n);
  for (int tile = 0; tile < grid.count(); ++tile) {
    const FaceRect r = tile_rect(grid, tile);
    int from = 0;
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
        out[(std::size_t(r.face) * n + std::size_t(y)) * n + std::size_t(x)] = f(tile, from++);
  }
  return out;
}

}  // namespace

void Environment::validate() const {
  if (last_seen.empty()) return;
  const TileGrid grid = radiance.tiles();
  check(last_seen.size() == grid.size, "an environment of a map of ", grid.size,
        " texels an edge needs times of as many, got ", last_seen.size(),
        "; for another map begin with environment_from()");
  const std::size_t count = std::size_t(grid.count()) * std::size_t(grid.stride());
  check(variance.size() == count, "an environment of a map of ", grid.size,
        " texels an edge needs ", count, " variances, got ", variance.size());
}

std::vector<float> Environment::confidence() const {
  validate();
  if (last_seen.empty())
    return std::vector<float>(6 * std::size_t(radiance.size()) * std::size_t(radiance.size()), 1);
  const TileGrid grid = radiance.tiles();
  return by_face(grid, [&](int tile, int texel) {
    const float elapsed = float(time - last_seen.at(tile, texel));
    if (elapsed > std::numeric_limits<float>::max()) return 0.0f;
    const std::size_t i = std::size_t(tile) * std::size_t(grid.stride()) + std::size_t(texel);
    const float relative = std::bit_cast<float>(std::uint32_t(variance[i]) << 16) +
                           kUnsureRate * kUnsureRate * elapsed;
    return 1 / (1 + relative / (0.1f * 0.1f));  // ½ at 10 % standard deviation
  });
}

std::vector<float> Environment::age() const {
  validate();
  if (last_seen.empty())
    return std::vector<float>(6 * std::size_t(radiance.size()) * std::size_t(radiance.size()), 0);
  return by_face(radiance.tiles(),
                 [&](int tile, int texel) { return float(time - last_seen.at(tile, texel)); });
}

Environment environment_from(CubeMap radiance) {
  Environment environment;
  environment.coverage = 1;
  environment.predicted_error = environment.predicted_high = 0;
  environment.radiance = std::move(radiance);
  return environment;
}

}  // namespace fastibl
