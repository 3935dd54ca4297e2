// How much each part of the sky contributes to the irradiance of the plane z = 0: sums over
// rectangles of a cube map's faces above the horizon, from summed-area tables (Crow 1984).
#pragma once

#include <span>
#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

inline constexpr int kSkyFaces = 5;  // +x −x +y −y, each half above the horizon, and +z
// Faces of at most so many texels are summed; bright texels are cut into those of the map itself.
inline constexpr int kSkyLevel = 64;

// A part of a table of `SkyEnergy`, in texels, not necessarily whole ones.
struct SkyRect {
  int table = 0;
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool operator==(const SkyRect&) const = default;
};

// A texel that is summed separately, from finer ones.
struct BrightTexel {
  int face, x, y;
  bool operator==(const BrightTexel&) const = default;
};

// The first five tables are the faces. Each bright texel has a table of its own, and is dark in its
// face's table. `weight` is that of the channel in which a part counts most: no colour is
// neglected.
class SkyEnergy {
 public:
  SkyEnergy() = default;
  // Texels with more than `brightest` of the weight get their own tables.
  SkyEnergy(const CubeMap& radiance, double brightest);
  // The same with given texels, whether bright or not.
  SkyEnergy(const CubeMap& radiance, std::span<const BrightTexel> bright);

  int tables() const { return int(tables_.size()); }
  const std::vector<BrightTexel>& bright() const { return bright_; }
  SkyRect whole(int table) const;
  bool no_light() const { return irradiance_ == glm::dvec3(0); }

  // The rectangle's share of the plane's irradiance in each channel, 0 in a channel without light.
  glm::dvec3 share(const SkyRect& rect) const;
  double weight(const SkyRect& rect) const;
  // The x (or y) in `rect` before which that part of its weight lies.
  double split_x(const SkyRect& rect, double part) const;
  double split_y(const SkyRect& rect, double part) const;
  // Whether the rectangle spans a larger angle along x than along y.
  bool is_wide(const SkyRect& rect) const;
  glm::vec3 direction(const SkyRect& rect, double x, double y) const;  // unit length, z > 0

 private:
  // Red, green and blue as shares of their sum over the sky, and weight.
  struct alignas(32) Sum {
    double value[4];
  };
  struct Table {
    int face, size;             // texels along an edge of the whole face
    int x0, y0, width, height;  // the part of it that is summed
    std::vector<Sum> sums;      // (width + 1) × (height + 1)
  };
  void read(const CubeMap& radiance);
  void make_tables(const CubeMap& radiance);
  Table bright_table(const CubeMap& radiance, const BrightTexel& texel,
                     const double* inverse) const;
  static Sum before(const Table& table, double x, double y);
  double weight_before(const Table& table, double x, double y) const;

  int size_ = 0, level_ = 0, finest_ = 0, parts_ = 1;
  glm::dvec3 irradiance_{0};
  std::vector<glm::vec3> energies_[kSkyFaces];
  std::vector<BrightTexel> bright_;
  std::vector<Table> tables_;
};

}  // namespace fastibl
