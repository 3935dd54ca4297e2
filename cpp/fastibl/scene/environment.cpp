#include "fastibl/scene/environment.h"

#include <limits>

namespace fastibl {
namespace {

// Of f(index by tile) for each texel, packed as the faces.
template <typename F>
std::vector<float> by_face(TileGrid grid, F&& f) {
  const std::size_t n = std::size_t(grid.size);
  std::vector<float> out(6 * n * n);
  for (int tile = 0; tile < grid.count(); ++tile) {
    const FaceRect r = tile_rect(grid, tile);
    std::size_t from = std::size_t(tile) * std::size_t(grid.stride());
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x)
        out[(std::size_t(r.face) * n + std::size_t(y)) * n + std::size_t(x)] = f(from++);
  }
  return out;
}

}  // namespace

std::vector<float> Environment::confidence() const {
  if (last_seen.empty())
    return std::vector<float>(6 * std::size_t(radiance.size()) * std::size_t(radiance.size()), 1);
  return by_face(radiance.tiles(), [&](std::size_t i) {
    const float elapsed = float(time - last_seen[i]);
    if (elapsed > std::numeric_limits<float>::max()) return 0.0f;
    const float relative = variance[i] + kUnsureRate * kUnsureRate * elapsed;
    return 1 / (1 + relative / (0.1f * 0.1f));  // ½ at 10 % standard deviation
  });
}

std::vector<float> Environment::age() const {
  if (last_seen.empty())
    return std::vector<float>(6 * std::size_t(radiance.size()) * std::size_t(radiance.size()), 0);
  return by_face(radiance.tiles(), [&](std::size_t i) { return float(time - last_seen[i]); });
}

Environment environment_from(CubeMap radiance) {
  Environment environment;
  environment.coverage = 1;
  environment.predicted_error = 0;
  environment.radiance = std::move(radiance);
  return environment;
}

}  // namespace fastibl
