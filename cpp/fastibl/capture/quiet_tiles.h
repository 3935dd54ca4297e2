// Which tiles of the map a picture need not update.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include "fastibl/capture/tile_pyramids.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

// How a picture shows a tile.
struct TileSighting {
  double time;                    // seconds
  float least_scale, most_scale;  // radiance per linear value
  float pixels;                   // number that a texel covers
};
inline TileSighting joined(const TileSighting& a, const TileSighting& b) {
  return {a.time, std::min(a.least_scale, b.least_scale), std::max(a.most_scale, b.most_scale),
          std::max(a.pixels, b.pixels)};
}

// A tile is made of 4 × 4 blocks. A picture leaves it out where
// - no more than kMostLeftOut pictures in a row did;
// - no texel's variance, with the drift of the place since, is more than kMostUnsure variances of
//   a sample of this picture;
// - no texel is a lower bound that this exposure could lift;
// - the picture agrees with the map at a probe in each block: on average the squared differences
//   are at most kMostDeviance of their variances.
// So what is left out is known to 2 standard deviations of one sample. Light that changes by more
// than 2 % over a tile, or much in a block, comes through at once, and any other change
// kMostLeftOut pictures later. Blocks are judged by the texels that were updated last: where the
// border of the picture cuts through a block, its other texels may also come kMostLeftOut pictures
// later.
class QuietTiles {
 public:
  static constexpr int kProbes = 16;
  static constexpr int kMostLeftOut = 5;
  static constexpr float kMostUnsure = 4.0f;
  static constexpr float kMostDeviance = 0.25f;

  explicit QuietTiles(TileGrid grid);

  // False if the tile cannot be left out, whatever the probes show.
  bool may_leave_out(int tile, double time) const;
  // Whether the tile is left out, which is counted. seen, deviance: by probe, whether it is seen,
  // and its deviance summed over three channels.
  bool leave_out(int tile, const TileSighting& sighting, const int* seen, const float* deviance);
  // For when a picture was taken into the tile. unsure: by block, see merge_samples. whole,
  // bounded: whether the picture showed all texels, and whether some are now only lower bounds.
  void took(int tile, const TileSighting& sighting, const float (&unsure)[kProbes], bool whole,
            bool bounded);
  // To be called after took(), once the tile's level of half the width is made.
  void place_probes(int tile, const TilePyramids& texels);
  // Raises `blocks` to the largest values in each block, of `count` texels of a tile from `first`
  // on.
  void add_blocks(int first, int count, const float* texels, float (&blocks)[kProbes]) const;

  // The texel that a probe stands for, in the tile's level of half the width.
  struct Place {
    int x, y;
  };
  void places(int tile, Place (&probes)[kProbes]) const;
  // By probe of the tile: the value in the map, and a variance for misregistration where the map is
  // not smooth.
  const float* value(int tile, int channel) const { return values(tile) + channel * kProbes; }
  const float* rough(int tile, int channel) const { return values(tile) + (3 + channel) * kProbes; }

 private:
  struct Tile {
    double taken[kProbes];  // by block: when it was last updated; −∞ if never
    float unsure[kProbes];  // as it was then
    float most_scale = 0, pixels = 0;
    float bound_scale = std::numeric_limits<float>::infinity();  // up to this no bound is lifted
    int left_out = 0;
    int turn = 0;  // where its probes are
  };
  const float* values(int tile) const { return &values_[std::size_t(tile) * 6 * kProbes]; }

  TileGrid grid_;
  int width_;  // of a tile at half the width; 0: tiles are too small or not of 2^k texels
  std::vector<Tile> tiles_;
  std::vector<float> values_;
};

}  // namespace fastibl
