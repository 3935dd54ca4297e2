// What is known of the light of a place: radiance around the marker, and how well it is known.
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

// Relative standard deviation by which a captured value becomes unsure within a second.
inline constexpr float kUnsureRate = 0.1f;

inline constexpr double kNever = -std::numeric_limits<double>::infinity();

// Times by texel, kept once for a tile where they are all the same. Texel k of tile t of a map at
// t · stride + k.
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
  // By texel; null where all of the tile have the same.
  const double* own(int tile) const {
    return same(tile) ? nullptr : &times_[std::size_t(tile) * stride_];
  }
  void set(int tile, double time) {
    common_[std::size_t(tile)] = time, same_[std::size_t(tile)] = 1;
  }
  // Of a tile whose texels are to have times of their own.
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

// What the error of a captured map depends on.
struct MapKnowledge {
  double unseen_sky = 0;   // share of the solid angle above the horizon that was never seen
  double unseen_flux = 0;  // share of the map's light in what was never seen
  double bound_flux = 0;   // share of the light above the horizon that is only a lower bound
  // Estimated share of the irradiance that is put wrong because things are near, and taken for far.
  double parallax = 0;
  double parallax_doubt = 0;  // may be put wrong as well: of how near things are little was seen
  double prior_flux = 0;      // share of the light that a map from before stands for
  double boosted_flux = 0;    // share of the light above the horizon that clipped, and was put back
  bool weighed = false;       // what is a bound was compared with the light that the plane shows
  // Relative error of all light where no exposure was told, as far as the plane shows it.
  double scale = 0;
};

// Relative error of an irradiance: what is expected, and the ends of a 90 % interval.
struct ErrorInterval {
  double expected = 1, low = 0, high = 1;
};

// As a Capture or a Session hands it out it stays as it is while a shared_ptr holds it. One that
// nobody holds is written anew: a pointer or weak_ptr to it then sees a later map. Whether a map
// changed, CubeMap::tile_version tells, and not its address.
struct Environment {
  CubeMap radiance = {};       // every texel has a value; unseen ones that of what was seen nearest
  double coverage = 0;         // share of the sphere's solid angle that was ever seen
  double clipped = 0;          // share of the seen solid angle whose value is only a lower bound
  double predicted_error = 1;  // expected relative error of the irradiance, a median over normals
  double predicted_low = 0, predicted_high = 1;  // ends of an interval that holds it 9 times in 10
  MapKnowledge knowledge = {};                   // that these rest on
  glm::dvec3 centre{0};             // metres, marker frame: where the radiance is seen from
  std::optional<RoomBox> box = {};  // whose walls the map shows, where they are known
  std::optional<glm::dvec3> plane_irradiance = {};  // RGB, as the board's paper shows it
  std::vector<LightPosition> light_positions = {};  // of those near enough to be triangulated

  // Of each texel: when it was last seen (seconds; −∞ never) and its variance then, relative to its
  // value's square: the upper half of a float, at t · stride + k. Empty: known everywhere.
  double time = 0;
  TexelTimes last_seen = {};
  std::vector<std::uint16_t> variance = {};

  // Throws std::invalid_argument where times or variances are of a map of another size, as where a
  // captured map was replaced.
  void validate() const;

  // 6 n², packed as the faces. These validate.
  std::vector<float> confidence() const;  // 0 (never seen) to 1
  std::vector<float> age() const;         // seconds since last seen; infinite if never
};

// A map that is known everywhere.
Environment environment_from(CubeMap radiance);

}  // namespace fastibl
