// What near lights give an object by the place of each of its vertices, not only by its normal.
#pragma once

#include <span>
#include <vector>

#include "fastibl/scene/lighting.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

// How the shares that these are added to were made.
enum class SharesOf {
  all,         // all light reaches all of the object
  visibility,  // the P_V of the scene
  directions   // diffuse_shares()
};

// Change of the share of its irradiance that reaches each vertex, by channel: the light of the near
// lights where the vertex is, less that at the map's centre, by the irradiance that the map gives
// the vertex. A light is a sphere of even radiance, of which the horizon and the object hide a part
// where it is. 0 where the map gives no irradiance, and at most kMostShare.
std::vector<glm::vec3> near_shares(const Scene& scene, const Lighting& lighting, SharesOf shares);

inline constexpr float kMostShare = 1000;

}  // namespace fastibl
