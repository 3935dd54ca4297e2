// The light as cube maps on the GPU. Private to render/gl.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "fastibl/render/gl/gpu.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/glossy.h"
#include "fastibl/scene/lighting.h"

namespace fastibl {

// The value of DIFFUSE in shared/irradiance.glsl for a method.
int irradiance_variant(const Gpu& gpu, DiffuseMethod method);

class LightTextures {
 public:
  // Uploads the levels as the CPU made them; for a map like the last one only what has changed, as
  // the versions of its tiles tell. Values in half floats are scaled: these end at 65504.
  void upload_radiance(Gpu& gpu, const std::shared_ptr<const CubeMap>& map);

  // Uploads what `sampled` reads: the map, and what near lights send.
  void upload_sampled(Gpu& gpu, const Lighting& lighting);

  // Uploads the round lobes, and the map that is their level 0.
  void upload_chain(Gpu& gpu, const std::shared_ptr<const GlossyChain>& chain);

  // Each binds what was uploaded last, for the program in use.
  void bind_radiance(Gpu& gpu, const Program& p) const;
  void bind_sampled(Gpu& gpu, const Program& p, const Lighting& lighting) const;
  void bind_chain(Gpu& gpu, const Program& p, const GlossyLobe& lobe, const Lighting& lighting);
  // Binds the uploaded chain, which is the lighting's, and its lights.
  void bind_lobes(Gpu& gpu, const Program& p, const Lighting& lighting) const;
  // Uploads and binds what irradiance is read from, for a program in use of that variant.
  void set_irradiance(Gpu& gpu, const Program& p, int variant, const Irradiance& irradiance);

 private:
  // Uploads irradiance-cube as it is: one look-up. Any other diffuse method is uploaded as a cube
  // map, where shaders are not to be trusted with it. Does nothing for the same texels.
  void upload_baked(Gpu& gpu, const Irradiance& irradiance);

  Texture cube_, near_, baked_, lobes_, first_lobe_, table_;
  // About the map that is in cube_. The map itself is not kept: its maker may update it in place.
  int radiance_size_ = 0, radiance_levels_ = 0;
  std::vector<std::uint64_t> radiance_versions_;
  std::shared_ptr<const CubeMap> near_map_;   // the one that is in near_
  float near_scale_ = 1;                      // and its scale
  std::shared_ptr<const GlossyChain> chain_;  // the chain that is in lobes_
  std::vector<glm::vec4> baked_texels_;       // those in baked_
  float radiance_scale_ = 1, baked_scale_ = 1;
};

}  // namespace fastibl
