// The shadow pass. Private to render/gl.
#pragma once

#include "fastibl/render/gl/gpu.h"
#include "fastibl/render/gl/light_textures.h"
#include "fastibl/render/renderer.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/scene_shadow.h"

namespace fastibl {

// Uploads an RGB map of the plane; does nothing for an empty one.
void upload(Gpu& gpu, const Image<float>& image, Texture& texture);

class ShadowPass {
 public:
  void run(Gpu& gpu, LightTextures& light, const RenderInput& in);
  void clear() { shadow_ = {}, caster_ = {}, read_ = true; }

  const ShadowMap& place() const { return shadow_; }  // without its ratio, which may be old
  const Texture& ratio() const { return ratio_; }
  const Texture& outer() const { return shadow_.outer.empty() ? ratio_ : outer_; }
  const Texture& fine() const { return shadow_.fine.empty() ? ratio_ : fine_; }
  const ShadowMap& shadow_map(Gpu& gpu);  // reads back; outside a scope

 private:
  Texture ratio_, outer_, fine_, spheres_;
  SceneShadow caster_;
  ShadowMap shadow_;  // its ratio is read back when asked for
  bool read_ = true;
};

}  // namespace fastibl
