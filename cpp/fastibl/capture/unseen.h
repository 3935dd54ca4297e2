// What stands for light that no picture has seen.
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
// horizon, weighted by the eighth power of nearness (Shepard's interpolation), and from there
// evenly over to the tiles around. It is steady from picture to picture: what was seen only just
// now, or clipped, counts little; a lamp at the border of the seen does not stand for half the sky;
// values follow once they are wrong by more than a small share.
class UnseenTiles {
 public:
  UnseenTiles(TileGrid grid, float plane_albedo);

  // What falls on the plane, as its paper shows it, RGB, and the standard deviation of that. What
  // no picture has seen of the sky is made so much brighter or darker that the sum agrees, as far
  // as both are to be believed: by a factor of a standard deviation of 1 around 1, and by what may
  // be there without a sign of it in what was seen. Holds until it is given again.
  void measure_plane(const glm::dvec3& irradiance, const glm::dvec3& deviation) {
    plane_ = irradiance, plane_deviation_ = deviation;
  }

  // Takes the sums of all tiles at `time` (seconds), of which `changed` have new ones; appends the
  // tiles whose fill changed to `refilled`, some of them more than once. Once a half has a fill, a
  // tile is looked at in every fourth call.
  void update(std::span<const int> changed, const std::vector<TileSums>& sums,
              const std::vector<double>& tile_projected, double time, std::vector<int>& refilled);

  // From now on the sky is known from elsewhere: its fills are given, the plane's follow them.
  void give_sky() { given_sky_ = true; }
  void give(int tile, glm::vec3 fill) { fill_[std::size_t(tile)] = fill; }

  // In the middle of a tile,
  glm::vec3 middle(int tile) const {
    const std::size_t i = std::size_t(tile);
    return above_[i] ? glm::min(brightness_ * fill_[i] + besides_, kRadianceCap) : fill_[i];
  }
  // and all over it: at each edge and corner the mean of the unseen tiles that meet there, on the
  // same side.
  FillPatch fill(int tile) const;
  // Irradiance of the plane by what was not seen of the sky, without what the plane says of it.
  glm::dvec3 sky_irradiance(const std::vector<TileSums>& sums,
                            const std::vector<double>& tile_projected) const;
  bool above(int tile) const { return above_[std::size_t(tile)]; }

 private:
  // Seen tiles of a half of the sphere, by component; as long as fills vectors.
  struct Sources {
    std::vector<float> x, y, z, weight, value[3];
  };
  Sources sources(bool above, const std::vector<TileSums>& sums, double time) const;
  void interpolate(bool above, const Sources& from, bool all, const std::vector<TileSums>& sums,
                   std::vector<int>& refilled);
  // Appends a tile and those around it, which run over to it.
  void append_with_neighbours(int tile, std::vector<int>& refilled) const;
  void find_brightness(const std::vector<TileSums>& sums, const std::vector<double>& tile_projected,
                       std::vector<int>& refilled);
  // One fill for a half of the sphere of which nothing was seen.
  void fill_half(bool above, glm::vec3 value, std::vector<int>& refilled);
  glm::vec3 sky_without_pictures(const std::vector<TileSums>& sums) const;

  TileGrid grid_;
  TileMeetings meetings_;
  float plane_albedo_;
  std::vector<float> x_, y_, z_;    // unit directions of the tiles' centres
  std::vector<int> above_;          // side of the horizon
  std::vector<std::uint8_t> open_;  // not all of the tile was seen
  std::vector<double> first_seen_;  // seconds; −∞ until then
  std::vector<glm::vec3> fill_;     // of the sky, without
  glm::vec3 brightness_{1};         // by which what the plane shows corrects it
  glm::vec3 besides_{0};            // and what it shows beyond that, radiance: of a dark sliver
  std::optional<glm::dvec3> plane_;
  glm::dvec3 plane_deviation_{0};
  bool seen_[2] = {false, false};  // below, above
  bool given_sky_ = false;
  int calls_ = 0;
};

}  // namespace fastibl
