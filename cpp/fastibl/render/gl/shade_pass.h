// The shade pass: finds which triangle each sample sees, then its colour. Private to render/gl.
#pragma once

#include "fastibl/render/gl/gpu.h"
#include "fastibl/render/gl/light_textures.h"
#include "fastibl/render/gl/material_textures.h"
#include "fastibl/render/gl/mesh_buffers.h"
#include "fastibl/render/gl/outline.h"
#include "fastibl/render/gl/pixel_parts.h"
#include "fastibl/render/gl/pixel_shares.h"
#include "fastibl/render/renderer.h"

namespace fastibl {

class ShadePass {
 public:
  void run(Gpu& gpu, LightTextures& light, const RenderInput& in);
  void clear() { area_ = {}, has_holdout_ = false; }

  const Area& area() const { return area_; }  // part of the image that object() holds
  const Texture& object() const { return scale_ > 1 ? mean_object_ : object_; }
  bool has_holdout() const { return has_holdout_; }
  // Of the same area.
  const Texture& holdout() const { return scale_ > 1 ? mean_holdout_ : holdout_; }
  ObjectLayer layer(Gpu& gpu) const;  // read back; outside a scope
  ObjectLayer holdout_layer(Gpu& gpu) const;

 private:
  void draw(Gpu& gpu, LightTextures& light, const RenderInput& in);
  // The area and what was drawn become the picture's size again.
  void reduce(Gpu& gpu);
  void average(Gpu& gpu, const Texture& large, Texture& mean);
  void draw_visible(Gpu& gpu, const RenderInput& in, const Outline& outline, const Outline& holdout,
                    const Outline& around);
  void draw_holdout(Gpu& gpu, const RenderInput& in);
  ObjectLayer read(Gpu& gpu, const Texture& texture) const;
  void draw_colour(Gpu& gpu, LightTextures& light, const RenderInput& in);
  void draw_pbr(Gpu& gpu, LightTextures& light, const RenderInput& in);
  void draw_layer(Gpu& gpu, const Program& p, const RenderInput& in);
  PixelParts parts() const { return {mesh_, visible_, area_}; }
  const char* by_pixel() const { return shares_by_pixel_ ? "BY_PIXEL 1" : "BY_PIXEL 0"; }

  MeshBuffers mesh_, holdout_mesh_;
  bool has_holdout_ = false;
  PixelShares pixel_shares_;
  bool shares_by_pixel_ = false;  // of the object; from pixel_shares_
  MaterialTextures material_;
  Texture visible_, object_, holdout_, albedo_;
  int scale_ = 1;  // how many times as large as the picture the last textures are
  Texture mean_object_, mean_holdout_;
  Area area_;  // of the textures while they are drawn, then of the picture
};

}  // namespace fastibl
