// One bounce of diffuse light between the object and the plane, and what it makes of the plane's
// picture.
#pragma once

#include <span>
#include <vector>

#include "fastibl/scene/lighting.h"
#include "fastibl/scene/scene.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/shading/plane_exchange.h"

namespace fastibl {

// The table below the horizon of the map is the plane without the object, so that the plane sends
// out π times that radiance times the shadow ratio: what a shadow takes from it, it takes from the
// object's underside. The object sends out its diffuse reflectance times its light, that change
// included, and what it emits; the plane's albedo scales its light by both ways alike, so that it
// need not be known.
// Left out: glossy reflection of either, and light that goes to and fro more than once.
struct Bounce {
  // By the irradiance of the plane without the object: what the object adds to it. Texels as those
  // of a ShadowMap, in the frame of `motion`; twice as far as the exchange, the border ones are 0,
  // as all beyond.
  Image<float> gain;
  glm::vec2 centre{0};
  float extent = 0;
  PlaneMotion motion;
  // Of the light at each vertex: change of its share by what the plane lacks.
  std::vector<glm::vec3> shares;

  bool empty() const { return gain.empty(); }
};

// Exitance of each vertex by its irradiance, and by itself; see Material. A texture is read where
// the vertex is, blurred.
struct Exitance {
  glm::vec3 reflectance, emission;
};
std::vector<Exitance> vertex_exitance(const Material& material, const Mesh& mesh);

// shares: of its irradiance that reaches each vertex, without the bounce; empty: P_V of the scene.
// Nothing where the plane is not lit, or the exchange does not hold where the object is.
Bounce find_bounce(const PlaneExchange& exchange, const Scene& scene, const Lighting& lighting,
                   const ShadowMap& shadow, std::span<const glm::vec4> shares);

// Shares with those of the bounce added, in place; none is negative.
void add_shares(const Bounce& bounce, std::span<glm::vec4> shares);

// What the picture of the plane is multiplied by, as a map: the ratio as its look has it, and the
// gain, which may take it above 1. It fades where the shadow map ends.
ShadowMap plane_gain(const ShadowMap& shadow, const ShadowLook& look, const Bounce& bounce);

}  // namespace fastibl
