// How a picture, whose rows may be taken one after the other, sees a map.
#pragma once

#include <cstddef>
#include <vector>

#include "fastibl/capture/camera_side.h"
#include "fastibl/capture/surroundings.h"
#include "fastibl/capture/texel_view.h"
#include "fastibl/capture/tile_geometry.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// A rolling shutter's rows are cut into bands that share a pose.
class PictureBands {
 public:
  // size: of the map.
  PictureBands(const PosedPicture& posed, const Viewpoint& viewpoint, int size);

  // As TexelView has it, for tiles that the picture shows at any time.
  void find_tiles(const TileOutlines& outlines, std::vector<float>& most_pixels) const;
  // Finds the band that shows each of the tiles. To be called before what follows, which is for
  // these tiles.
  void place(const std::vector<int>& tiles, const TileGeometry& geometry,
             const Surroundings& surroundings);
  int count() const { return int(texels_.size()); }
  int band(int tile) const { return rolls_.empty() ? 0 : rolls_[std::size_t(tile)].band; }
  const TexelView& texels(int tile) const { return texels_[std::size_t(band(tile))]; }
  // The same for a map of half the size.
  const TexelView& halved(int tile) const { return halved_[std::size_t(band(tile))]; }
  // Moves texels of the tile off the row whose pose projected them to where their own row shows
  // them.
  void unroll(int tile, int first, int count, Sightings& sightings) const;

 private:
  // How a rolling shutter shows a tile.
  struct Roll {
    int band = 0;        // of rows that are taken with one pose
    float row = 0;       // of that pose
    glm::vec2 drift{0};  // pixels a row by which later poses see the tile elsewhere
  };
  Roll roll_of(const TexelGroup& middle, bool above) const;

  float width_, height_;  // of the picture
  std::vector<TexelView> texels_, halved_;
  std::vector<Roll> rolls_;  // by tile; empty for one band
};

}  // namespace fastibl
