// What a map holds for light that no picture shows: where none has seen, and of lights that clip.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/capture/capture_options.h"
#include "fastibl/capture/clipped_lights.h"
#include "fastibl/capture/map_tiles.h"
#include "fastibl/capture/prior_map.h"
#include "fastibl/capture/unseen.h"
#include "fastibl/core/vector.h"

namespace fastibl {

class MapFills {
 public:
  // Fills a map of which nothing was seen.
  MapFills(const CaptureOptions& options, MapTiles& map);

  bool has_prior() const { return prior_.has_value(); }
  // Flux of the part of a tile that was not seen, summed over RGB.
  double flux(int tile, const MapTiles& map) const {
    const std::size_t i = std::size_t(tile);
    const glm::dvec3 fill(filled_[i]);
    return std::max(map.geometry.tile_angle[i] - map.sums[i].angle, 0.0) *
           (fill.x + fill.y + fill.z);
  }
  double mean_radiance(const MapTiles& map) const;  // 0, not a guess, where nothing was seen
  // Irradiance of the plane from the unseen part of the sky.
  glm::dvec3 sky_irradiance(const MapTiles& map) const;

  // For when the board's white was read.
  void measure_plane(const glm::dvec3& irradiance);
  // Lights that clip in the shortest exposure may be made brighter by this factor, 1: not at all.
  void boost_up_to(double most) { most_boost_ = most; }
  bool boosts() const { return most_boost_ > 1; }
  const ClippedLights& clipped_lights() const { return clipped_; }
  // How many tiles may get new values for their unseen texels, if a picture is taken at `time`.
  // still: pictures without times of their own, no film. What other cameras took at a time that
  // came long after the one before it counts as much as the first of these pictures.
  int refills_after(double time, bool still) const;
  // What follows from tiles that a picture changed at `time`. plane_irradiance: as the board's
  // white showed it last.
  void take(const std::vector<int>& changed, int refills,
            const std::optional<glm::dvec3>& plane_irradiance, double time, MapTiles& map);
  // For when texels of these tiles were forgotten or moved.
  void refill(const std::vector<int>& changed, MapTiles& map);
  // For when all of the map was made anew,
  void renew(double time, MapTiles& map);
  // and for when the marker was turned, too. plane_irradiance: as the board's white still tells it.
  void turn(const glm::dmat3& new_from_old, const std::optional<glm::dvec3>& plane_irradiance,
            double time, MapTiles& map);

 private:
  // Gives the tile's unseen texels their value; false if there are none.
  bool refill(int tile, MapTiles& map);
  void refill_from_prior(int tile, MapTiles& map);
  void give_prior();  // to unseen_
  void refill_stale(int refills, std::uint64_t version, MapTiles& map);
  // Whether the value of the tile's unseen texels is close to what it should be.
  bool is_small_refill(int tile) const;
  // True if all is to be refilled at once. Appends the tiles whose fill changed.
  bool match_prior(const std::optional<glm::dvec3>& plane_irradiance, const MapTiles& map,
                   std::vector<int>& refilled);
  // Learns how bright lights that clip may be, as the plane shows it, and makes them so if they may
  // be boosted; returns the tiles that show it.
  std::vector<int> weigh_bounds(const glm::dvec3& plane_irradiance, MapTiles& map);

  float plane_albedo_;
  double most_boost_ = 1;
  ClippedLights clipped_;
  UnseenTiles unseen_;
  std::optional<PriorMap> prior_;
  std::vector<int> sky_;                  // tiles above the horizon, where there is a prior
  std::vector<glm::vec3> filled_;         // by tile: the mean of unseen texels in the map
  std::vector<std::uint8_t> stale_fill_;  // where that no longer agrees with unseen_
  std::vector<int> new_sums_;             // tiles that unseen_ does not know yet
  int next_refill_ = 0, pictures_ = 0;
  double last_taken_ = -1e30;  // seconds
  bool all_then_ = false;      // whether all tiles could get new values then
};

}  // namespace fastibl
