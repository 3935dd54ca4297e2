// Takes a picture into a map.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/capture/camera_side.h"
#include "fastibl/capture/exposure_doubt.h"
#include "fastibl/capture/frame_levels.h"
#include "fastibl/capture/map_tiles.h"
#include "fastibl/capture/picture_bands.h"
#include "fastibl/capture/picture_reader.h"
#include "fastibl/capture/place_layout.h"
#include "fastibl/capture/quiet_tiles.h"
#include "fastibl/capture/texel_state.h"
#include "fastibl/capture/texel_view.h"
#include "fastibl/capture/tile_views.h"

namespace fastibl {

// How a picture is to be taken.
struct Taking {
  Taken taken;
  double time;    // seconds
  double bright;  // radiance of what is a light
  bool plane;     // whether the camera's place is known
  bool shortest;  // whether what clips in it clips in every exposure
};

// For one picture; what it is given must outlive it.
class PictureTaker {
 public:
  PictureTaker(const PosedPicture& posed, const Taking& how, const PlaceLayout& place,
               MapTiles& map, TileViews& views, FrameLevels& levels);

  // Appends the tiles that changed; false if the map holds nothing of the picture.
  bool take(std::vector<int>& changed);

 private:
  // Returns the number of pixels that a texel covers at most.
  float find_tiles();
  // Removes tiles of the sky that were seen whole from much nearer to the centre than now.
  void leave_out_far_tiles();
  // Removes those that the picture need not give.
  void leave_out_quiet_tiles();
  // Those that may be quiet, in groups that are seen alike: by band of rows, face and side of the
  // horizon.
  std::vector<std::vector<int>> quiet_groups() const;
  void compare_probes(std::span<const int> tiles);  // of one such group
  // Leaves out texels of a tile that any picture showed; false if none is left.
  bool leave_out_seen(int tile, int first, int count, Sightings& sightings) const;
  // How the picture shows the tile, from the `count` texels that were read from `first` on.
  TileSighting sighting(int tile, const Sightings& sightings, const Samples& samples, int first,
                        int count) const;
  // Takes what the picture shows of a tile; true if it shows any of its texels.
  bool add_tile(int tile);
  bool is_usual(int tile) const;  // whether it shows no light whose place is known

  const PosedPicture& posed_;
  const Taking& how_;
  const PlaceLayout& place_;
  MapTiles& map_;
  TileViews& views_;
  FrameLevels& levels_;
  PictureBands bands_;
  PictureReader reader_;
  std::vector<float> most_pixels_;  // by tile: that a texel covers
  std::vector<int> tiles_;          // that the picture may see
  std::vector<std::uint8_t> left_out_;
};

}  // namespace fastibl
