// A map from before, which stands for what no picture has seen.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "fastibl/capture/texel_state.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

class PriorMap {
 public:
  // A map of another size than the grid's is read from its MIP level, or interpolated.
  PriorMap(std::shared_ptr<const CubeMap> map, TileGrid grid);
  // For when the marker was turned.
  void turn(const glm::dmat3& new_from_old);

  // Finds the brightness of the place now relative to then, by channel: the median over tiles that
  // were seen nearly whole; where these are few, the light that falls on the plane divided by what
  // the map gives for it. Returns by what share that changed, 0 for little. sky: tiles above the
  // horizon.
  float match(const std::vector<TileSums>& sums, std::span<const double> tile_angle,
              std::span<const double> tile_projected, std::span<const int> sky,
              const std::optional<glm::dvec3>& plane_irradiance);
  bool matched() const { return matched_ != Matched::no; }

  // The prior as bright as the place is now.
  glm::vec3 mean(int tile) const {
    return glm::min(gain_ * means_[std::size_t(tile)], kRadianceCap);
  }
  glm::vec3 texel(int tile, int k) const {
    return glm::min(gain_ * texels_[std::size_t(tile) * stride_ + std::size_t(k)], kRadianceCap);
  }

 private:
  void read();

  std::shared_ptr<const CubeMap> map_;
  TileGrid grid_;
  glm::dmat3 now_from_then_{1};
  std::size_t stride_;
  std::vector<glm::vec3> texels_, means_;
  glm::vec3 gain_{1};
  enum class Matched { no, by_plane, by_tiles } matched_ = Matched::no;
};

}  // namespace fastibl
