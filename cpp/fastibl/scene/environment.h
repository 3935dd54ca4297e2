// What is known of the light of a place: radiance around the marker, and how well it is known.
#pragma once

#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

struct Environment {
  CubeMap radiance;  // every texel has a value; unseen ones that of the nearest seen texel
  std::vector<float> confidence;  // 6 n², packed as the faces: 0 (never seen) to 1
  std::vector<float> age;         // 6 n², seconds since last seen; infinite if never
  double coverage = 0;            // share of the sphere's solid angle that was ever seen
  double clipped = 0;             // share of the seen solid angle whose value is only a lower bound
  double predicted_error = 1;     // expected relative error of the irradiance
};

// A map that is known everywhere.
Environment environment_from(CubeMap radiance);

}  // namespace fastibl
