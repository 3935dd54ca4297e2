// What shading needs to know of the light, and how it is read.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/glossy_chain.h"
#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/near_light.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

struct Lighting {
  Irradiance irradiance;
  bool has_irradiance = false;              // whether that was asked for
  GlossyMethod glossy = GlossyMethod::mip;  // never `automatic`
  GlossySettings glossy_settings;
  Normalization normalization = Normalization::energy;
  std::shared_ptr<const CubeMap> radiance;   // with the MIP levels that `mip` reads
  std::vector<std::uint64_t> versions;       // CubeMap::tile_versions() of it as it was read
  std::shared_ptr<const GlossyChain> chain;  // what other methods read, with the lights
  glm::vec3 plane_irradiance{0};             // E(z), summed over the map
  std::optional<double> irradiance_error;    // relative, RMS, of `irradiance`; none: not
                                             // measured; 0 where no irradiance was asked for
  // The lights of the map whose place is known. All other fields hold their light too, as distant.
  NearLights near_lights;
  // What the first kMostSampledNear of them send, as the map has it; null where none is near, and
  // for methods other than `sampled`.
  std::shared_ptr<const CubeMap> near_radiance;
  // Walls that glossy surfaces see at their true place, around the centre of near_lights.
  std::optional<RoomBox> box = {};
  std::vector<float>
      light_distances;  // inverse, 1 / m, of each light of the chain; 0 where distant
};

}  // namespace fastibl
