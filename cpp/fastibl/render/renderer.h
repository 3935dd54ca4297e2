// The interface of a back end: it casts the shadow, shades the object and makes the picture.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "fastibl/plan/plan.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/object_layer.h"
#include "fastibl/scene/picture.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/shading/near_shares.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

// The passes that each back end has for itself; the others are the same code for all.
inline constexpr std::array kRenderPasses = {PassId::shadow, PassId::shade, PassId::composite};

// The input of one frame's passes. References are valid for the call.
struct RenderInput {
  const Scene& scene;
  const Methods& methods;
  const Lighting& lighting;
  const Camera* camera;  // never null
  const Pose& camera_from_marker;
  const Picture& back;  // empty: the object on transparent
  double exposure;
  // Shares of its light that the object lets through at each vertex, and perhaps after them at the
  // vertices' backs: of the irradiance (RGB), and of the glossy term. Empty: P_V of the scene, and
  // the whole glossy term.
  std::span<const glm::vec4> light_shares = {};
  // What the plane's picture is multiplied by, where that is not the ratio of the shadow pass. A
  // changed map is passed as a new object.
  std::shared_ptr<const ShadowMap> plane_gain = nullptr;
  // Share of its light that is left to each vertex of the scene's holdouts (RGB), and 1. Empty: all
  // light is left.
  std::span<const glm::vec4> holdout_ratios = {};
  // light_shares of the map alone, where near lights or the plane change those.
  std::span<const glm::vec4> self_shares = {};
  const NearShares* near_shares = nullptr;  // what near lights change in light_shares, if anything
  const CellLight* cell_light = nullptr;  // that these shares were found with, if any
  bool shades_alike_as_one = false;       // see Plan; a GPU shades each triangle's part by itself
  int supersampling = 1;                  // see SessionOptions
};

class Renderer {
 public:
  virtual ~Renderer() = default;
  virtual std::string_view backend() const = 0;
  virtual std::string device() const { return {}; }  // GL_RENDERER; empty: the processor
  // Whether it has a self-shadow method; all have those that find shares for vertices.
  virtual bool has(SelfShadowMethod method) const = 0;
  // Runs one of kRenderPasses; throws std::invalid_argument for another.
  virtual void run(PassId pass, const RenderInput& input) = 0;
  // Forgets a pass's product, and what its next run would build on. The ratio is then 1, or nothing
  // covers the picture.
  virtual void clear(PassId pass) = 0;
  // The picture alone is the image until the next run of composite; an empty one: a transparent
  // image of the camera's size.
  virtual void show(const Picture& back, const Camera& camera) = 0;

  // Of the last run of shade, where they are counted.
  virtual std::optional<PartCounts> parts() const { return std::nullopt; }

  // The products of each pass's last run; a GPU back end reads them back. The shadow map stays as
  // it is until the next run.
  virtual const ShadowMap& shadow_map() = 0;
  virtual ObjectLayer object() = 0;
  virtual ObjectLayer holdout() = 0;  // see holdout_layer()
  // The camera of the texture that composite draws over in place of RenderInput::back, see
  // GlRenderer; RenderInput::camera must be this one. Null: there is no texture.
  virtual const Camera* texture_camera() const { return nullptr; }

  // 3 channels, or 4 (straight alpha) without a back picture. The memory of `out` is used again.
  virtual void image(Image<std::uint8_t>& out) = 0;
  Image<std::uint8_t> image() {
    Image<std::uint8_t> out;
    image(out);
    return out;
  }
};

std::unique_ptr<Renderer> make_cpu_renderer();

}  // namespace fastibl
