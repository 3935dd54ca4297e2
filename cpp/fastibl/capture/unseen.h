// What stands in for light that no picture has seen.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "fastibl/capture/fill_patch.h"
#include "fastibl/capture/texel_state.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

// For each tile the light of its unseen texels: the mean of what was seen on the same side of the
// horizon, weighted by the eighth power of nearness (Shepard's interpolation), blended smoothly
// into the tiles around. It is steady from picture to picture: what was seen only just now, or
// clipped, counts little; a lamp at the border of the seen part does not stand for half the sky;
// values are renewed once they are wrong by more than a small share.
class UnseenTiles {
 public:
  UnseenTiles(TileGrid grid, float plane_albedo);

  // Gives the light that falls on the plane, as its paper shows it, RGB, and the standard deviation
  // of that. The unseen part of the sky is made so much brighter or darker that the sum agrees, as
  // far as both are to be believed: by a factor with a standard deviation of 1 around 1, and by
  // what may be there without a sign of it in what was seen. Holds until it is given again.
  void measure_plane(const glm::dvec3& irradiance, const glm::dvec3& deviation) {
    plane_ = irradiance, plane_deviation_ = deviation;
  }

  // Takes the sums of all tiles at `time` (seconds), of which those of `changed` are new, and
  // appends the tiles whose fill changed to `refilled`, some of them more than once. Once a half of
  // the sphere has a fill, each tile is looked at in every fourth call; or all at once.
  void update(std::span<const int> changed, const std::vector<TileSums>& sums,
              const std::vector<double>& tile_projected, double time, bool at_once,
              std::vector<int>& refilled);

  // From now on the sky is known from elsewhere: its fills are given, and those of the plane
  // follow.
  void give_sky() { given_sky_ = true; }
  void give(int tile, glm::vec3 fill) { fill_[std::size_t(tile)] = fill; }

  // The fill in the middle of a tile,
  glm::vec3 middle(int tile) const {
    const std::size_t i = std::size_t(tile);
    return above_[i] ? glm::min(brightness_ * fill_[i] + besides_, kRadianceCap) : fill_[i];
  }
  // and all over it: at each edge and corner the mean of the unseen tiles that meet there, on the
  // same side.
  FillPatch fill(int tile) const;
  // Irradiance of the plane from the unseen part of the sky, before what the plane shows corrects
  // it.
  glm::dvec3 sky_irradiance(const std::vector<TileSums>& sums,
                            const std::vector<double>& tile_projected) const;

 private:
  // Seen tiles of a half of the sphere, by component; padded to whole vectors.
  struct Sources {
    std::vector<float> x, y, z, weight, value[3];
  };
  Sources sources(bool above, const std::vector<TileSums>& sums, double time) const;
  void interpolate(bool above, const Sources& from, bool first, bool at_once,
                   const std::vector<TileSums>& sums, std::vector<int>& refilled);
  // Appends a tile and those around it, whose fills blend into it.
  void append_with_neighbours(int tile, std::vector<int>& refilled) const;
  void find_brightness(const std::vector<TileSums>& sums, const std::vector<double>& tile_projected,
                       std::vector<int>& refilled);
  // Sets one fill for a half of the sphere of which nothing was seen.
  void fill_half(bool above, glm::vec3 value, std::vector<int>& refilled);
  glm::vec3 sky_without_pictures(const std::vector<TileSums>& sums) const;

  TileGrid grid_;
  TileMeetings meetings_;
  float plane_albedo_;
  std::vector<float> x_, y_, z_;    // unit directions of the tiles' centres
  std::vector<int> above_;          // side of the horizon
  std::vector<std::uint8_t> open_;  // not all of the tile was seen
  std::vector<double> first_seen_;  // seconds; −∞ until then
  std::vector<glm::vec3> fill_;     // for the sky without the two corrections below
  glm::vec3 brightness_{1};         // factor by which what the plane shows corrects it
  glm::vec3 besides_{0};            // and radiance beyond what that may give, as of a dark sliver
  std::optional<glm::dvec3> plane_;
  glm::dvec3 plane_deviation_{0};
  bool seen_[2] = {false, false};  // below, above
  bool given_sky_ = false;
  int calls_ = 0;
};

}  // namespace fastibl
