// What is known about the light of a place: the radiance around the marker, and how certain it is.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/cube_tiles.h"
#include "fastibl/scene/light_position.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

// Relative standard deviation by which a captured value becomes uncertain within a second.
inline constexpr float kUnsureRate = 0.1f;

inline constexpr double kNever = -std::numeric_limits<double>::infinity();

// A time for each texel; a tile whose texels all have the same time stores it once. Texel k of tile
// t of a map is at t · stride + k.
class TexelTimes {
 public:
  TexelTimes() = default;
  explicit TexelTimes(TileGrid grid)  // never
      : size_(grid.size),
        stride_(std::size_t(grid.stride())),
        times_(std::size_t(grid.count()) * stride_, kNever),
        common_(std::size_t(grid.count()), kNever),
        same_(std::size_t(grid.count()), 1) {}

  bool empty() const { return times_.empty(); }
  int size() const { return size_; }  // texels along an edge of a face
  bool same(int tile) const { return same_[std::size_t(tile)] != 0; }
  double at(int tile, int texel) const {
    return same(tile) ? common_[std::size_t(tile)]
                      : times_[std::size_t(tile) * stride_ + std::size_t(texel)];
  }
  // The tile's times by texel; null where all its texels have the same.
  const double* own(int tile) const {
    return same(tile) ? nullptr : &times_[std::size_t(tile) * stride_];
  }
  void set(int tile, double time) {
    common_[std::size_t(tile)] = time, same_[std::size_t(tile)] = 1;
  }
  // The times of a tile whose texels are to have their own, for writing.
  double* texels(int tile) {
    double* times = &times_[std::size_t(tile) * stride_];
    if (same(tile)) std::fill_n(times, stride_, common_[std::size_t(tile)]);
    same_[std::size_t(tile)] = 0;
    return times;
  }
  void copy(int tile, const TexelTimes& from) {
    const std::size_t t = std::size_t(tile);
    same_[t] = from.same_[t], common_[t] = from.common_[t];
    if (!same_[t]) std::copy_n(&from.times_[t * stride_], stride_, &times_[t * stride_]);
  }

 private:
  int size_ = 0;
  std::size_t stride_ = 0;
  std::vector<double> times_, common_;
  std::vector<std::uint8_t> same_;  // 0: as in times_
};

// The quantities that the error of a captured map depends on.
struct MapKnowledge {
  double unseen_sky = 0;   // share of the solid angle above the horizon that was never seen
  double unseen_flux = 0;  // share of the map's light in what was never seen
  // The part of that in a plane of which little was seen: by an albedo that is assumed, or by what
  // a sliver shows.
  double guessed_plane = 0;
  double bound_flux = 0;  // share of the light above the horizon that is only a lower bound
  // The part of that which clips in the shortest exposure, and was compared with the plane's light.
  double weighed_flux = 0;
  double weighed_spread = 0;  // how far apart that is: 1 − length of its mean direction by light
  double bound_doubt = 0;     // share of the light that lower bounds may lack still
  // Estimated share of the irradiance that is misplaced because near things are taken for far ones.
  double parallax = 0;
  double parallax_doubt = 0;  // may be misplaced as well: little was seen of how near things are
  double prior_flux = 0;      // share of the light that comes from an earlier map
  double boosted_flux = 0;    // share of the light above the horizon that clipped and was restored
  bool metered = false;       // the light that falls on the plane was measured
  // Relative error of all light where no exposure was told, as far as the plane shows it.
  double scale = 0;
};

// Relative error of an irradiance: the expected value, and the ends of a 90 % interval.
struct ErrorInterval {
  double expected = 1, low = 0, high = 1;
};

// An environment that a Capture or a Session hands out stays unchanged while a shared_ptr holds it.
// One that nobody holds is reused: a pointer or weak_ptr to it then sees a later map. To find out
// whether a map changed, compare CubeMap::tile_version, not its address.
struct Environment {
  CubeMap radiance = {};       // every texel has a value; unseen ones from what was seen near
  double coverage = 0;         // share of the sphere's solid angle that was ever seen
  double clipped = 0;          // share of the seen solid angle whose value is only a lower bound
  double predicted_error = 1;  // expected relative error of the irradiance, a median over normals
  double predicted_low = 0, predicted_high = 1;  // ends of an interval that holds it 9 times in 10
  MapKnowledge knowledge = {};                   // that these predictions rest on
  glm::dvec3 centre{0};             // metres, marker frame: where the radiance is seen from
  std::optional<RoomBox> box = {};  // whose walls the map shows, where it was told
  std::optional<glm::dvec3> plane_irradiance = {};  // RGB, as the board's paper shows it
  std::vector<LightPosition> light_positions = {};  // of lights near enough to be triangulated

  // For each texel: when it was last seen (seconds; −∞ for never), and its variance then, relative
  // to the square of its value: the upper half of a float, at t · stride + k. Empty: known
  // everywhere.
  double time = 0;
  TexelTimes last_seen = {};
  std::vector<std::uint16_t> variance = {};

  // Throws std::invalid_argument where the times or variances belong to a map of another size, as
  // they do where a captured map was replaced.
  void validate() const;

  // 6 n² values each, packed like the faces. Both call validate().
  std::vector<float> confidence() const;  // 0 (never seen) to 1
  std::vector<float> age() const;         // seconds since last seen; infinite if never
};

// A map that is known everywhere.
Environment environment_from(CubeMap radiance);

}  // namespace fastibl
