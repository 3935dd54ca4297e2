// Cube maps of linear radiance. A direction in the marker frame is the OpenGL cube coordinate,
// without any rotation.
//
//            +---------+
//            |   +y    |        Faces in the order +x −x +y −y +z −z. Row 0 of the ±x and ±z faces
//            | row 0:  |        lies towards +y, that of +y towards −z, that of −y towards +z.
//            |  −z     |        Seen from inside, as OpenGL has it:
//  +---------+---------+---------+---------+
//  |   −x    |   +z    |   +x    |   −z    |     face   s (right)   t (down)
//  | row 0:  | row 0:  | row 0:  | row 0:  |     +x       −z          −y
//  |  +y     |  +y     |  +y     |  +y     |     −x       +z          −y
//  +---------+---------+---------+---------+     +y       +x          +z
//            |   −y    |                         −y       +x          −z
//            | row 0:  |                         +z       +x          −y
//            |  +z     |                         −z       −x          −y
//            +---------+
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_reduction.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

// Where a direction meets the cube: the face, and the point on it; s and t are in [0, 1], t grows
// downwards.
struct FacePoint {
  int face;
  float s, t;
};
FacePoint face_point(glm::vec3 direction);             // any length but 0
glm::vec3 face_direction(int face, float s, float t);  // not normalised: length in [1, √3]
inline glm::vec3 texel_direction(int face, int x, int y, int size) {  // not normalised
  return face_direction(face, (float(x) + 0.5f) / float(size), (float(y) + 0.5f) / float(size));
}
// The texel of a map of `size` that a direction meets.
struct TexelPlace {
  int face, x, y;
};
inline TexelPlace texel_at(const FacePoint& p, int size) {
  const auto along = [&](float s) { return std::clamp(int(s * float(size)), 0, size - 1); };
  return {p.face, along(p.s), along(p.t)};
}
inline TexelPlace texel_at(const glm::vec3& direction, int size) {
  return texel_at(face_point(direction), size);
}

// Exact solid angle of texel (x, y) of a face (arctangent of the corners); all 6 n² sum to 4π.
double texel_solid_angle(int x, int y, int size);
// The solid angles of all n² texels of a face, row by row.
std::vector<double> texel_solid_angles(int size);

// Edges of a face. The texels along an edge are numbered from the left, or from the top.
enum class CubeEdge { top, bottom, left, right };

// One MIP level. Each face is stored with a border of one texel copied from the adjacent faces (at
// a corner the mean of three), so that bilinear filtering is seamless without a branch.
class CubeLevel {
 public:
  CubeLevel() = default;
  explicit CubeLevel(int size);

  int size() const { return size_; }
  glm::vec3& texel(int face, int x, int y) { return texels_[index(face, x, y)]; }
  const glm::vec3& texel(int face, int x, int y) const { return texels_[index(face, x, y)]; }
  // Texel (0, 0) of a face; the row above lies `row_stride()` texels before it.
  glm::vec3* face(int f) { return &texels_[index(f, 0, 0)]; }
  const glm::vec3* face(int f) const { return &texels_[index(f, 0, 0)]; }
  std::ptrdiff_t row_stride() const { return size_ + 2; }
  std::ptrdiff_t face_stride() const { return std::ptrdiff_t(size_ + 2) * (size_ + 2); }

  // To be called after texels were written, before sample().
  void update_border() { update_border(kAllEdges); }
  // The same where only texels along some edges were written: bit 4 f + e for CubeEdge e of face f.
  static constexpr unsigned kAllEdges = (1u << 24) - 1;
  void update_border(unsigned edges);
  glm::vec3 sample(glm::vec3 direction) const;  // seamless bilinear
  glm::vec3 sample(const FacePoint& p) const;
  // Weighted by solid angle. All levels of a map have the same mean: to 1e-7 where edges are halved
  // evenly; to half a percent where an edge of 7 becomes one of 3.
  glm::dvec3 mean() const;
  bool operator==(const CubeLevel&) const = default;

 private:
  std::size_t index(int face, int x, int y) const {
    return std::size_t(face * face_stride() + (y + 1) * row_stride() + (x + 1));
  }
  int size_ = 0;
  std::vector<glm::vec3>
      texels_;  // one more at the end, so that four floats can be loaded anywhere
};

// What cleaning of the input did: NaN and negative values become 0; infinite values and those above
// the cap become the cap.
struct CleaningStatistics {
  int nan = 0, negative = 0, capped = 0;  // numbers of values (not texels)
  int total() const { return nan + negative + capped; }
  bool operator==(const CleaningStatistics&) const = default;
};
inline constexpr float kRadianceCap = 1e9f;  // its square still sums in float32 without overflow
float clean_radiance(float value, CleaningStatistics& statistics);
bool all_clean(const float* values, int count);

// A number that no tile of any map has yet.
std::uint64_t new_tile_version();

// Radiance over the sphere with its MIP chain. Every level is the solid-angle mean of the next
// finer one, so each level holds the same energy (a plain 2×2 mean over-weights the corners of the
// cube).
class CubeMap {
 public:
  CubeMap() = default;  // of size 0: has no levels, and cannot be looked up
  // faces: 6 n² texels, packed face by face; they are cleaned. Throws for size < 1 or another
  // length.
  CubeMap(int size, std::span<const glm::vec3> faces);
  // A black map, to be written through base(). Throws for size < 1.
  explicit CubeMap(int size);

  int size() const { return levels_.empty() ? 0 : levels_[0].size(); }
  int level_count() const { return int(levels_.size()); }  // level k has faces of max(1, n >> k)
  const CubeLevel& level(int k) const { return levels_[std::size_t(k)]; }
  // The finest level whose faces are at most `size` texels wide.
  const CubeLevel& level_at_most(int size) const;
  const CleaningStatistics& cleaned() const { return cleaned_; }
  // For code that builds a map and cleaned its input itself.
  void set_cleaned(const CleaningStatistics& statistics) { cleaned_ = statistics; }

  // Level 0, for the code that builds the map to write: clean values only, and none in a border.
  // update() then renews what depends on it, bit for bit as if everything were made anew. Where NaN
  // or infinity was written, update() cleans the map.
  CubeLevel& base();
  void update();                              // everything changed
  void update(std::span<const int> changed);  // tiles
  // The same where the caller has written the first `written` levels of the tiles, as CubeReduction
  // makes them. These levels are wide enough that tiles share no texels.
  CubeLevel& base(int level) { return levels_[std::size_t(level)]; }
  void update(std::span<const int> changed, int written);

  // Where two maps of one size have the same version of a tile, they have the same texels in it. So
  // what is derived from a map need only be renewed where the map changed.
  TileGrid tiles() const { return {size()}; }
  std::uint64_t tile_version(int tile) const { return versions_[std::size_t(tile)]; }
  std::span<const std::uint64_t> tile_versions() const { return versions_; }
  // For a copied tile: the version in the map it was copied from. update() gives new versions.
  void set_tile_version(int tile, std::uint64_t version) { versions_[std::size_t(tile)] = version; }

  // Seamless trilinear look-up. The level is clamped to [0, level_count − 1]; NaN becomes 0.
  glm::vec3 sample(glm::vec3 direction, float level) const;
  glm::dvec3 mean() const;
  bool operator==(const CubeMap& other) const {
    return levels_ == other.levels_ && cleaned_ == other.cleaned_;
  }

 private:
  void update_levels(std::vector<FaceRect> changed, int written);
  void clean_row(int face, int y);
  std::vector<CubeLevel> levels_;
  std::vector<std::shared_ptr<const CubeReduction>> reductions_;  // from level k to k + 1
  std::vector<std::uint64_t> versions_;                           // of the tiles
  CleaningStatistics cleaned_;
};

}  // namespace fastibl
