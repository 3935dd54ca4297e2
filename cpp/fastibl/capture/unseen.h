// What stands for light that no picture has seen.
#pragma once

#include <span>
#include <vector>

#include "fastibl/capture/texel_state.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

// For each tile the value of its unseen texels: the mean of the nearest tile that was seen in part,
// on the same side of the horizon. Values follow their source once it has moved by more than a
// small share, so that a few noisy texels do not change half the map at every picture.
class UnseenTiles {
 public:
  UnseenTiles(TileGrid grid, float plane_albedo);

  // Takes the sums of all tiles, of which `changed` have new ones; appends the tiles whose fill
  // changed to `refilled`.
  void update(std::span<const int> changed, const std::vector<TileSums>& sums,
              const std::vector<double>& tile_projected, std::vector<int>& refilled);

  glm::vec3 fill(int tile) const { return fill_[std::size_t(tile)]; }
  bool above(int tile) const { return above_[std::size_t(tile)]; }

 private:
  void add_source(int tile);
  // Fills of a half of the sphere of which nothing was seen.
  void fill_half(bool above, glm::vec3 value, std::vector<int>& refilled);
  glm::vec3 sky_without_pictures(const std::vector<TileSums>& sums) const;

  TileGrid grid_;
  float plane_albedo_;
  std::vector<float> x_, y_, z_;  // unit directions of the tiles' centres
  std::vector<int> above_;        // side of the horizon
  std::vector<int> source_;       // −1: none yet
  std::vector<float> nearness_;   // cosine between a tile and its source
  std::vector<glm::vec3> mean_;   // of a source, as fills were last made with it
  std::vector<glm::vec3> fill_;
  bool seen_[2] = {false, false};  // below, above
};

}  // namespace fastibl
