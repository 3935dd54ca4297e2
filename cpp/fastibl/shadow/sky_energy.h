// How much each part of the sky gives to the irradiance of the plane z = 0: sums over rectangles of
// a cube map's faces above the horizon, from summed-area tables (Crow 1984).
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

inline constexpr int kSkyFaces = 5;  // +x −x +y −y, of which half is above the horizon, and +z

// A part of a face of `SkyEnergy::size()`, in texels, not whole ones alone.
struct SkyRect {
  int face = 4;
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool operator==(const SkyRect&) const = default;
};

class SkyEnergy {
 public:
  SkyEnergy() = default;
  // Texels of odd or few ones are split, so that the horizon is an edge of texels.
  explicit SkyEnergy(const CubeLevel& radiance);

  int size() const { return size_; }
  // Of a face above the horizon.
  SkyRect face(int f) const;
  // The plane's irradiance; of what is seen at less than 1e-3 above the horizon, nothing counts.
  const glm::dvec3& irradiance() const { return irradiance_; }
  bool no_light() const { return irradiance_ == glm::dvec3(0); }

  // Its share of the plane's irradiance in each channel, 0 in one without light.
  glm::dvec3 share(const SkyRect& rect) const;
  // The sum of the shares: no colour starves.
  double weight(const SkyRect& rect) const;
  // Mean direction by weight, unit length; the middle of one without light.
  glm::vec3 direction(const SkyRect& rect) const;
  // The x (or y) of `rect` before which lies that weight.
  double split_x(const SkyRect& rect, double weight) const;
  double split_y(const SkyRect& rect, double weight) const;

 private:
  // Shares of red, green and blue, their sum, and direction by that sum.
  struct Sum {
    double value[8];
  };
  struct Table {
    int x0 = 0, y0 = 0, width = 0, height = 0;  // where it lies on the face
    std::vector<Sum> sums;                      // (width + 1) × (height + 1)
  };
  Sum before(const Table& table, double x, double y) const;
  Sum sum(const SkyRect& rect) const;
  double weight_before(const Table& table, int x, double y) const;

  int size_ = 0;
  glm::dvec3 irradiance_{0};
  std::array<Table, kSkyFaces> tables_;
};

}  // namespace fastibl
