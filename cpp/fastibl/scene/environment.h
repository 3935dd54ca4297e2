// What is known of the light of a place: radiance around the marker, and how well it is known.
#pragma once

#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

// Relative standard deviation by which a captured value becomes unsure within a second.
inline constexpr float kUnsureRate = 0.1f;

struct Environment {
  CubeMap radiance;            // every texel has a value; unseen ones that of what was seen nearest
  double coverage = 0;         // share of the sphere's solid angle that was ever seen
  double clipped = 0;          // share of the seen solid angle whose value is only a lower bound
  double predicted_error = 1;  // expected relative error of the irradiance

  // Of each texel: when it was last seen (seconds; −∞ never) and its variance then, relative to its
  // value's square. Texel k of tile t of the radiance at t · stride + k. Empty: known everywhere.
  double time = 0;
  std::vector<double> last_seen;
  std::vector<float> variance;

  // 6 n², packed as the faces.
  std::vector<float> confidence() const;  // 0 (never seen) to 1
  std::vector<float> age() const;         // seconds since last seen; infinite if never
};

// A map that is known everywhere.
Environment environment_from(CubeMap radiance);

}  // namespace fastibl
