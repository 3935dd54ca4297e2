// The scale of what cameras showed that tell no exposure, found from the board's white in another
// one's pictures.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/capture/map_tiles.h"
#include "fastibl/core/vector.h"

namespace fastibl {

class AssumedScale {
 public:
  explicit AssumedScale(TileGrid grid);

  // Notes the scale of tiles that a picture changed. assumed_of: its camera (KnownCamera::first) if
  // the camera's scale was assumed, else 0. untold: no exposure came with it.
  void note(const std::vector<int>& tiles, int assumed_of, bool untold);
  // For when the board's white was read in that camera's pictures: what it showed is in its own
  // scale.
  void know(int camera);
  // For when tiles now show what others did: by tile, which.
  void move(const std::vector<int>& from);
  // For when each tile of the sky now shows parts of several others, and the plane nothing.
  void mix(const MapTiles& map);
  bool any(const MapTiles& map) const;  // whether the map holds anything in an assumed scale
  // Makes what is in an assumed scale as bright as the board's white says; appends such tiles.
  void mend(MapTiles& map, const glm::dvec3& plane_irradiance, double time,
            std::vector<int>& changed);
  int mended() const { return mended_; }  // how often

 private:
  // The factor for that, if it is known: `factor` where more of the sky was seen than before, else
  // its change if that may be believed. share: of the sky that was seen.
  std::optional<double> mending(double share, double factor, bool follow, double time);

  std::vector<int> scales_;  // by tile: one of those in the source, or the camera with such a scale
  double scaled_at_ = 0;     // share of the sky that had been seen when the scale was last checked
  struct Balance {           // what the white and the seen sky said of the scale
    double factor, share;
    double since;  // seconds: when they last agreed with that
  };
  std::optional<Balance> balance_;
  int mended_ = 0;
};

// Relative error of the plane's irradiance from the sky of a map with an assumed scale, by what the
// board's white says, if that was read.
double scale_error(const glm::dvec3& sky_irradiance,
                   const std::optional<glm::dvec3>& plane_irradiance);

}  // namespace fastibl
