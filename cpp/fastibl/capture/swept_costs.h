// How badly pictures agree if what is seen in a direction is at a distance.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

// Squared differences of pairs of pictures, summed by direction from the centre of the map, above
// the horizon, and by inverse distance.
class SweptCosts {
 public:
  static constexpr std::array<double, 13> kSwept{0,    0.05, 0.1, 0.15, 0.2, 0.25, 0.3,
                                                 0.35, 0.4,  0.5, 0.6,  0.8, 1};  // 1 / metres
  static constexpr std::size_t kUsual = 6;  // of these: about that of a room's walls

  // For a point seen in that direction, if its inverse distance is kSwept[k].
  void add(std::size_t k, const glm::dvec3& direction, double cost);
  // Whether there are enough of them in that direction, where the usual distance puts a point.
  bool enough(const glm::dvec3& direction) const;

  // What was seen around one direction.
  struct Part {
    glm::dvec3 direction;                    // of unit length
    double weight = 0;                       // points
    std::array<double, kSwept.size()> cost;  // of all of them, by inverse distance
    double at(double inverse_distance) const;
  };
  std::vector<Part> parts() const;  // those that were seen

 private:
  static constexpr int kAcross = 24;  // of an octahedral map
  static constexpr std::uint32_t kEnough = 128;
  struct Sum {
    double cost = 0;
    std::uint32_t count = 0;
  };
  static std::size_t place(const glm::dvec3& direction);
  std::vector<std::array<Sum, kSwept.size()>> sums_ =
      std::vector<std::array<Sum, kSwept.size()>>(std::size_t(kAcross) * kAcross);
};

}  // namespace fastibl
