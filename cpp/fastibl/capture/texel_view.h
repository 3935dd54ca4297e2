// Which texels of the map a picture sees, and where.
#pragma once

#include <vector>

#include "fastibl/capture/surroundings.h"
#include "fastibl/core/pose.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/cube_tiles.h"

namespace fastibl {

// Where the map is seen from, and what it shows: see CaptureOptions.
struct Viewpoint {
  glm::dvec3 centre;
  const Surroundings& surroundings;  // of the same centre
  glm::dvec2 masked{
      -1, -1};  // half width and height of the plane's part around the origin to leave out
};

// Texels are worked on in groups of this many.
inline constexpr int kTexelLanes = 256;
// The lanes that a group of `count` texels takes: filled up to whole vectors, and no more.
constexpr int lanes_of(int count) { return (count + 15) & ~15; }

// Where a group of a tile's texels is on its face; beyond the last texel arrays may hold anything.
struct TexelGroup {
  int face;
  float first_s, first_t;       // of the tile's first texel: 2 s − 1 and 2 t − 1 of its centre
  float step;                   // from texel to texel
  const float *columns, *rows;  // column and row of each texel in its tile
  int count;
  int width;    // of the tile
  Depth depth;  // of what it shows above the horizon
};

// Corners of all tiles of a map, for leaving out the tiles that a picture cannot see.
struct TileOutlines {
  explicit TileOutlines(TileGrid grid);  // arrays are padded to whole vectors

  struct Corner {
    std::vector<float> x, y, z;  // direction, 1 along the face's axis
    std::vector<float> scale;    // 1 / its length
  };
  TileGrid grid;
  Corner corners[4];
  std::vector<float> bulge;  // by how far, at most, the unit sphere lies beyond the corners' plane
  glm::dvec3 middle(int tile) const;  // unit length
  double reach(int tile) const;       // radians from there to the corners
  std::vector<float> above,
      below;  // 0 or 1: whether the tile has texels on this side of the horizon
};

struct Sightings {
  alignas(64) float x[kTexelLanes], y[kTexelLanes];  // pixel position
  alignas(64) float pixels[kTexelLanes];             // that the texel covers
  alignas(64) int seen[kTexelLanes];  // 0 or 1; where it is 0 the other arrays may hold anything
};

// Sides of a picture on the plane z = 1, without the lens.
struct PictureBounds {
  float left, right, top, bottom;
};
PictureBounds picture_bounds(const Camera& camera, const Lens& lens);

class TexelView {
 public:
  // lens, bounds: those of the camera. size: texels along an edge of a face.
  TexelView(const Camera& camera, const Lens& lens, const PictureBounds& bounds,
            const Pose& camera_from_marker, const Viewpoint& viewpoint, int size);

  // For each tile: the number of pixels that one of its texels covers at most (an estimate); 0
  // where no texel is seen.
  void find_tiles(const TileOutlines& outlines, std::vector<float>& most_pixels) const;
  // True if any texel of the group is seen.
  bool see(const TexelGroup& group, Sightings& sightings) const;
  // Pixel position of the group's first texel, also outside the picture; arbitrary behind the
  // camera.
  glm::vec2 pixel(const TexelGroup& group, bool above) const;
  // Like the first see(), for a group on one side of the horizon.
  bool see(const TexelGroup& group, bool above, Sightings& sightings) const;

  // In float, for a direction d that is not normalised: its camera direction is `turn` d, plus,
  // above the horizon, `shift` times |d| over its distance.
  struct Projection {
    float turn[3][3];  // columns
    float shift[3];
    bool shifted;
    float walls[2][3];     // of Surroundings
    glm::vec2 walls_axis;  // of its surface
    bool above;
    float plane_distance, centre_x, centre_y, masked_x, masked_y;
    bool masked;
    float fx, fy, cx, cy, k[8], limit2;
    bool lens;
    float width, height;
    float pixels;  // that a texel covers at depth 1
  };

 private:
  Projection facing(const glm::vec3& light) const;
  glm::dmat3 turn_;    // camera_from_marker
  glm::dvec3 centre_;  // of the map, camera frame
  Projection above_, below_;
  bool sees_plane_;
  const Surroundings& surroundings_;
  PictureBounds bounds_;
};

// The smallest rotation that takes one unit vector to another; they may not be opposite.
glm::dmat3 rotation_between(const glm::dvec3& from, const glm::dvec3& to);

}  // namespace fastibl
