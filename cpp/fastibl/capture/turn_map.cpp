// Turns a captured map after the marker was turned under it.
#include <algorithm>
#include <cmath>
#include <limits>

#include "fastibl/capture/capture.h"
#include "fastibl/core/check.h"

namespace fastibl {
void Capture::turn(const glm::dmat3& new_from_old) {
  check(is_rotation(new_from_old, 1e-3), "a map can only be turned by a rotation");
  const TexelState old = state_;
  state_ = TexelState(grid_);
  const glm::mat3 old_from_new(glm::transpose(new_from_old));
  const std::size_t stride = std::size_t(grid_.stride());
  // Averages those of the four texels around a texel's place that were seen, as if looked up there.
  const auto take = [&](int tile, int k, const glm::vec3& direction, float half) {
    const std::size_t to = std::size_t(tile) * stride + std::size_t(k);
    const glm::vec3 side = glm::normalize(glm::cross(
        direction, std::abs(direction.z) < 0.9f ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0)));
    const glm::vec3 other = glm::cross(direction, side);
    float count = 0, value[3] = {}, variance[3] = {};
    double seen = kNever;
    std::uint8_t bound = 0;
    for (int corner = 0; corner < 4; ++corner) {
      const glm::vec3 d = direction + half * ((corner & 1 ? 1.0f : -1.0f) * side +
                                              (corner & 2 ? 1.0f : -1.0f) * other);
      if (!(d.z > 0)) continue;  // the plane
      const TexelPlace at = texel_at(d, grid_.size);
      const TilePlace from = tile_place(grid_, at.face, at.x, at.y);
      const double time = old.last_seen.at(from.tile, from.texel);
      if (!(time > kNever)) continue;
      const std::size_t i = std::size_t(from.tile) * stride + std::size_t(from.texel);
      for (int c = 0; c < 3; ++c) value[c] += old.value[c][i], variance[c] += old.variance[c][i];
      bound |= old.bound[i], seen = std::max(seen, time), ++count;
    }
    if (count == 0) return;
    for (int c = 0; c < 3; ++c) {
      state_.value[c][to] = value[c] / count;
      // Adds what may differ within a texel.
      const float blur = kModelNoise * value[c] / count;
      state_.variance[c][to] = variance[c] / count + blur * blur;
    }
    state_.bound[to] = bound;
    state_.last_seen.texels(tile)[k] = seen;
  };
  for (int tile = 0; tile < grid_.count(); ++tile) {
    if (!unseen_.above(tile)) continue;
    const FaceRect r = tile_rect(grid_, tile);
    int k = 0;
    for (int y = r.y0; y < r.y1; ++y)
      for (int x = r.x0; x < r.x1; ++x, ++k)
        take(tile, k, old_from_new * glm::normalize(texel_direction(r.face, x, y, grid_.size)),
             0.4f / float(grid_.size));
  }
  tracks_ = LightTracks(options_.centre);
  surroundings_ = Surroundings(outlines_, options_.centre, options_.distance, options_.box);
  quiet_ = QuietTiles(grid_);
  prior_.reset(), sky_.clear();  // it was given for the marker as it lay before
  plane_seen_.assign(plane_seen_.size(), 0), at_rim_.assign(at_rim_.size(), 0);
  vantage_.assign(vantage_.size(), std::numeric_limits<float>::max());  // tiles mix: seen from afar
  scales_.assign(scales_.size(), kOwnScale);  // tiles mix
  renew_all();
}

// Renews everything that is derived from the state.
void Capture::renew_all() {
  std::vector<int> all, refilled;
  const std::uint64_t version = new_tile_version();
  unseen_ = UnseenTiles(grid_, float(options_.plane_albedo));
  for (int tile = 0; tile < grid_.count(); ++tile) {
    const std::size_t start = std::size_t(tile) * std::size_t(grid_.stride());
    relate_variances(state_, start, tile_rect(grid_, tile).texels());
    sums_[std::size_t(tile)] = sum_of(tile);
    if (state_.last_seen.same(tile) && state_.last_seen.at(tile, 0) == kNever)
      sums_[std::size_t(tile)] = TileSums{};
    all.push_back(tile);
    versions_[std::size_t(tile)] = version;
  }
  new_sums_.clear();
  unseen_.update(all, sums_, tile_projected_, time_, refilled);
  for (const int tile : all)
    if (!refill(tile)) make_levels(tile);
}

}  // namespace fastibl
