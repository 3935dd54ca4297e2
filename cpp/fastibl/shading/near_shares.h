// What near lights give an object by the place of each vertex, not only by its normal.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/scene/lighting.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

// How the shares were made that these are added to.
enum class SharesOf {
  all,         // all light reaches all of the object
  visibility,  // the P_V of the scene
  directions   // diffuse_shares()
};

// What the object hides of a near light from an entry of its directions, and around it.
enum class NearState : std::uint8_t { low, open, hidden, mixed };  // low: below the tangent plane

// Keeps what depends on the place of a light, which changes far less than its brightness.
class NearShares {
 public:
  // Change of the share of its irradiance that reaches each vertex, by channel: the near lights'
  // light at the vertex, less that at the map's centre, divided by the irradiance that the map
  // gives the vertex. A light is a sphere of even radiance, of which the horizon and the object
  // hide a part as seen from there. 0 where the map gives no irradiance, and at most kMostShare. A
  // light that moved by no more than kKeptAngle, and whose distance and size are the same within
  // 0.3 and 1 %, is taken where it was. At the edge of what the object hides, it may then be off by
  // that angle's part of a cell of the visibility: 0.6 % of such a light.
  std::vector<glm::vec3> update(const Scene& scene, const Lighting& lighting, SharesOf shares);

  struct OfLight {
    NearLight light;             // its place is that for which these were found
    std::vector<float> changes;  // in units of its irradiance on a facing surface, by entry
    // By entry, for SharesOf::directions where it is not as good as distant; else empty. open: its
    // part that nothing hides, where it is above the tangent plane.
    std::vector<NearState> states;
    std::vector<float> open;
  };
  // Of the last update.
  const std::vector<OfLight>& lights() const { return lights_; }
  glm::vec3 centre() const { return basis_.centre; }  // of the map, marker frame
  // Another one where anything but an irradiance is new in lights(); of any NearShares.
  std::uint64_t version() const { return version_; }

  static constexpr float kMostShare = 1000;
  static constexpr float kKeptAngle = 6e-4f;  // radians

 private:
  // What all this was worked out for.
  struct Basis {
    const void *vertices = nullptr, *visibility = nullptr;
    std::size_t count = 0;
    Pose marker_from_object;
    glm::vec3 centre{0};
    SharesOf shares = SharesOf::all;
    bool operator==(const Basis&) const = default;
  };
  Basis basis_;
  std::vector<OfLight> lights_;
  std::uint64_t version_ = 0;
};

}  // namespace fastibl
