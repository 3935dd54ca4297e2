// Directions of light that stay where they are while the light changes: only their shares follow
// it. If they were chosen anew for every map, they would move, and every edge of the shadow with
// them.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/shadow/light_directions.h"

namespace fastibl {

class SteadyLight {
 public:
  // What an update changed: the directions, too, or their shares alone.
  enum class Change { none, shares, directions };

  explicit SteadyLight(int count = 256);
  int count() const { return count_; }

  // Takes over a map. When a part of the sky has come to count four times as much as the mean, or
  // half of the parts would do, the sky is split anew, and the new directions are faded in over
  // kFadeUpdates updates, faster in proportion to the light that moves meanwhile. When an eighth of
  // the light moves at once, the place has changed: the sky is split as if there had been no other.
  Change update(const CubeMap& radiance);

  // During a fade, those of both sets.
  const std::vector<LightDirection>& directions() const { return directions_; }
  bool no_light() const { return no_light_; }

  static constexpr int kFadeUpdates = 32;

 private:
  struct Set {
    std::vector<BrightTexel> bright;
    std::vector<SkyPart> parts;
    std::vector<LightDirection> light;  // under the last map
  };
  Set split(const CubeMap& radiance) const;
  static void follow(const CubeMap& radiance, Set& set);
  bool same_map(const CubeMap& radiance);
  void mix();

  int count_;
  Set current_;
  std::optional<Set> next_;
  double fade_ = 0;  // of `next_`, in [0, 1]
  bool no_light_ = true;
  std::vector<LightDirection> directions_;
  int map_size_ = 0;
  std::vector<std::uint64_t> map_versions_;
};

}  // namespace fastibl
