// One bounce of diffuse light between the object and the plane, and its effect on the plane's
// picture.
#pragma once

#include <span>
#include <vector>

#include "fastibl/scene/lighting.h"
#include "fastibl/scene/scene.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/shading/plane_exchange.h"

namespace fastibl {

// The table below the map's horizon is the plane without the object. So the plane sends out π times
// that radiance times the shadow ratio: the light that a shadow takes from the plane is also
// missing from the object's underside. The object sends out its diffuse reflectance times its
// light, with that change included, and what it emits. The plane's albedo scales its light with and
// without the object alike, so that it need not be known.
// Left out: glossy reflection by either, and light that goes back and forth more than once.
struct Bounce {
  // What the object adds to the plane's irradiance, divided by that of the plane without the
  // object. Texels as those of a ShadowMap, in the frame of `motion`. It reaches 2 to 16 times as
  // far as the exchange, by how bright it is there, and fades along a circle; its border texels are
  // 0, and so is all beyond.
  Image<float> gain;
  glm::vec2 centre{0};
  float extent = 0;
  PlaneMotion motion;
  // For each vertex: change of its share of the light, by what the plane lacks.
  std::vector<glm::vec3> shares;

  bool empty() const { return gain.empty(); }
};

// Exitance of each vertex: what it reflects of its irradiance, and what it emits; see Material. A
// texture is read at the vertex, blurred.
struct Exitance {
  glm::vec3 reflectance, emission;
};
std::vector<Exitance> vertex_exitance(const Material& material, const Mesh& mesh);

// shares: of its irradiance that reaches each vertex, without the bounce; empty: P_V of the scene.
// The result is empty where the plane is not lit, or where the exchange does not hold for the
// object's pose.
Bounce find_bounce(const PlaneExchange& exchange, const Scene& scene, const Lighting& lighting,
                   const ShadowMap& shadow, std::span<const glm::vec4> shares);

// Adds the shares of the bounce to these shares, in place; none becomes negative.
void add_shares(const Bounce& bounce, std::span<glm::vec4> shares);

// Factor on the plane's picture, as a map: the ratio as `look` changes it, and the gain, which may
// take it above 1, and for which the map's outer part reaches farther where it must.
ShadowMap plane_gain(const ShadowMap& shadow, const ShadowLook& look, const Bounce& bounce);

}  // namespace fastibl
