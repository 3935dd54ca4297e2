// The light as cube maps on the GPU. Private to render/gl.
#pragma once

#include <memory>

#include "fastibl/render/gl/gpu.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/lighting.h"

namespace fastibl {

class LightTextures {
 public:
  // Level by level as the CPU made them. Half floats are scaled: they end at 65504.
  void upload_radiance(Gpu& gpu, const std::shared_ptr<const CubeMap>& map);
  // irradiance-cube as it is: one look-up. Any other diffuse method as a cube map, where shaders
  // are not to be trusted with it.
  void upload_baked(Gpu& gpu, const Irradiance& irradiance);

  // What was uploaded last, for the program in use.
  void bind_radiance(Gpu& gpu, const Program& p) const;
  void bind_baked(Gpu& gpu, const Program& p) const;

 private:
  Texture cube_, baked_;
  // That is in cube_; kept alive, so its address is its own.
  std::shared_ptr<const CubeMap> radiance_;
  int baked_size_ = 0;
  float radiance_scale_ = 1, baked_scale_ = 1;
};

}  // namespace fastibl
