// A list of lit directions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/core/lanes.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/shading/light_sums.h"

namespace fastibl {

// Directions with their light: see LitDirections, whose padding pad() adds.
struct LitList {
  std::vector<float> x, y, z, solid_angles;
  std::vector<float> channels[3];

  void add(glm::vec3 direction, float solid_angle, glm::vec3 flux) {
    x.push_back(direction.x), y.push_back(direction.y), z.push_back(direction.z);
    solid_angles.push_back(solid_angle);
    for (int c = 0; c < 3; ++c) channels[c].push_back(flux[c]);
  }
  void pad() {
    while (x.size() % kLanes != 0) add({0, 0, 1}, 0, glm::vec3(0));
  }
  void clear() {
    for (std::vector<float>* values :
         {&x, &y, &z, &solid_angles, &channels[0], &channels[1], &channels[2]})
      values->clear();
  }
  std::size_t size() const { return x.size(); }
  glm::vec3 direction(std::size_t i) const { return {x[i], y[i], z[i]}; }
  glm::vec3 flux(std::size_t i) const { return {channels[0][i], channels[1][i], channels[2][i]}; }
  LitDirections lit() const {
    return {x.data(),
            y.data(),
            z.data(),
            solid_angles.data(),
            {channels[0].data(), channels[1].data(), channels[2].data()},
            x.size()};
  }

  // Whether rays from a place in some of the directions meet the object: 1 where they do.
  std::vector<std::uint8_t> met(const Bvh& bvh, glm::vec3 from,
                                std::span<const std::size_t> asked) const {
    DirectionSet set(int(asked.size()));
    for (std::size_t i = 0; i < asked.size(); ++i) set.set(int(i), direction(asked[i]));
    std::vector<std::uint8_t> result(asked.size(), 0);
    bvh.occluded(from, set, 0, result);
    return result;
  }
};

}  // namespace fastibl
