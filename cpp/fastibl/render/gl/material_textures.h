// A pbr material's textures on the GPU. Private to render/gl.
#pragma once

#include <array>
#include <memory>

#include "fastibl/render/gl/gpu.h"
#include "fastibl/scene/material.h"

namespace fastibl {

class MaterialTextures {
 public:
  // Uploads the levels as the CPU made them, in half floats.
  void upload(Gpu& gpu, const Material& material);
  void bind(Gpu& gpu, const Program& p) const;  // what was uploaded last
  // Factor from stored to true values of the emission map that was uploaded last.
  float emission_unit() const;

 private:
  static constexpr int kMaps = 5;
  struct Map {
    Texture texture;
    std::shared_ptr<const SurfaceTexture>
        shown;  // that is in it; kept alive, so its address is its own
  };
  std::array<Map, kMaps> maps_;
  Texture albedo_;
  std::shared_ptr<const GgxAlbedo> table_;
};

}  // namespace fastibl
