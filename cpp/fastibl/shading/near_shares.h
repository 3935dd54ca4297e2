// What near lights give an object by the place of each of its vertices, not only by its normal.
#pragma once

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

// Keeps what depends on where a light is, which changes far less than how bright it is.
class NearShares {
 public:
  // Change of the share of its irradiance that reaches each vertex, by channel: the light of the
  // near lights where the vertex is, less that at the map's centre, by the irradiance that the map
  // gives the vertex. A light is a sphere of even radiance, of which the horizon and the object
  // hide a part where it is. 0 where the map gives no irradiance, and at most kMostShare. Lights
  // that moved by no more than kKeptAngle, and whose distance and size are the same within 0.3 and
  // 1 %, are taken where they were: a part of that over a cell of the visibility, 0.6 % of such a
  // light, may be off at the edge of what the object hides.
  std::vector<glm::vec3> update(const Scene& scene, const Lighting& lighting, SharesOf shares);

  static constexpr float kMostShare = 1000;
  static constexpr float kKeptAngle = 6e-4f;  // radians

 private:
  struct Kept {
    NearLight light;             // as it was then
    std::vector<float> changes;  // of its irradiance on a facing surface, by vertex
  };
  // What all of it was worked out for.
  struct Basis {
    const void *vertices = nullptr, *visibility = nullptr;
    std::size_t count = 0;
    Pose marker_from_object;
    glm::vec3 centre{0};
    SharesOf shares = SharesOf::all;
    bool operator==(const Basis&) const = default;
  };
  Basis basis_;
  std::vector<Kept> kept_;
};

}  // namespace fastibl
