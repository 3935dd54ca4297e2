// From a map to what shading reads.
#pragma once

#include <memory>

#include "fastibl/scene/environment.h"
#include "fastibl/scene/lighting.h"

namespace fastibl {

struct LightingOptions {
  DiffuseMethod diffuse = DiffuseMethod::automatic;
  DiffuseSettings diffuse_settings = {};
  GlossyMethod glossy = GlossyMethod::automatic;
  GlossySettings glossy_settings = {};
  Normalization normalization = Normalization::energy;
  bool irradiance = true;     // false: only what glossy surfaces read
  bool plane = false;         // also E(z), where no other irradiance is asked for
  bool chain = true;          // false: nothing glossy will be shaded
  bool measure_error = true;  // also compare the irradiance with a sum over the 32² level (0.1
                              // ms); false: only when irradiance_error() asks for it
  int evaluations = 0;        // how many normals follow; 0: many. `automatic` decides by it
  bool follows = false;       // this map is one of many in a row: `automatic` takes what is steady
  // The environment that the map belongs to, if its lights' places are to be used; null: all light
  // is distant.
  const Environment* environment = nullptr;
};
// previous: the lighting of the frame before, or null. What was found then is moved along instead
// of searched anew, which is faster, and steady; a chain of the same map is kept. Throws
// std::invalid_argument without a map, and for settings out of range.
Lighting fit_lighting(std::shared_ptr<const CubeMap> radiance, const LightingOptions& options = {},
                      const Lighting* previous = nullptr);

// Whether a method reads Lighting::chain; fit_chain() adds a chain to a lighting that has none.
bool reads_chain(GlossyMethod method);
void fit_chain(Lighting& lighting, const std::shared_ptr<const GlossyChain>& previous = nullptr);
// Sets Lighting::near_radiance, for lighting whose near lights were set after it was fitted. known:
// that of the same map and lights, or null.
void fit_near_radiance(Lighting& lighting, const std::shared_ptr<const CubeMap>& known = nullptr);
// Adds the chain if it is missing, as in lighting fitted while nothing glossy was to be shaded.
void ensure_chain(Lighting& lighting);
// The error of the irradiance relative to a sum over its map's level of at most 128² texels; it is
// measured if it was not yet.
double irradiance_error(Lighting& lighting);

}  // namespace fastibl
