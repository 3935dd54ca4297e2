// What the object hides of its light from single pixels, for the shade pass. Private to render/gl.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "fastibl/render/gl/gpu.h"
#include "fastibl/render/gl/light_textures.h"
#include "fastibl/render/gl/pixel_parts.h"
#include "fastibl/render/renderer.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/vertex_visibility.h"
#include "fastibl/shading/hidden_masks.h"
#include "fastibl/shading/lobe_cells.h"
#include "fastibl/shading/near_tracer.h"
#include "fastibl/shading/traced_lights.h"

namespace fastibl {

class PixelShares {
 public:
  static bool has(SelfShadowMethod method) { return has_pixel_lobes(method); }
  // Finds the shares of all parts of pixels, see pixel_shares.frag.glsl. Returns whether there are
  // any: where there are none, those between the corners of triangles are right.
  bool find(Gpu& gpu, LightTextures& light, const PixelParts& parts, const RenderInput& in);
  // Binds those of the last find(), for the program in use.
  void bind(Gpu& gpu, const Program& p, const Area& area) const;

 private:
  void upload(Gpu& gpu, const Scene& scene, const std::optional<LobeCells>& lobe, bool rays);
  void upload_entries(Gpu& gpu, const Scene& scene, bool rays, bool masks);
  void upload_tree(Gpu& gpu, const Bvh& bvh);
  void upload_bright(Gpu& gpu, const BrightCells& cells, const BrightCells& for_lobes);
  void upload_lobe(Gpu& gpu, const LobeCells& lobe);
  void bind_lobe(Gpu& gpu, const Program& p, const LobeCells& lobe, const LobeShape& shape);
  void set_tiles(const Program& p, const Area& area) const;
  void bind_rays(Gpu& gpu, const Program& p, const RenderInput& in);
  void bind_near(Gpu& gpu, const Program& p, const NearTracer& near_tracer,
                 const NearShares& shares, const Scene& scene);

  Texture entries_, lobe_masks_, lobe_cells_, tree_, bright_, self_shares_, shares_, near_lights_,
      near_entries_;
  int columns_ = 2;  // of tiles in shares_
  EntryCells known_;
  HiddenMasks masks_;
  // Of what the textures are.
  struct Masks {
    std::shared_ptr<const VertexVisibility> visibility;
    int size = 0;
    bool operator==(const Masks&) const = default;
  };
  struct Entries {
    Masks masks;
    bool rays = false;
    bool operator==(const Entries&) const = default;
  };
  // Which lights, of which NearShares.
  struct Near {
    std::uint64_t version = 0;
    std::vector<std::ptrdiff_t> lights;
    bool operator==(const Near&) const = default;
  };
  Near near_of_;
  bool without_near_ = false;  // whether bright_ leaves near lights out of lobes
  std::shared_ptr<const Bvh> tree_of_;
  Masks masks_of_;
  Entries entries_of_;
  std::vector<glm::vec4> own_;    // those in self_shares_
  std::vector<float> lobe_flux_;  // of the cells in lobe_cells_, whose number tells their grid
};

}  // namespace fastibl
