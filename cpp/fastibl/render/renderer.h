// What a back end does: cast the shadow, shade the object, make the picture.
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
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

// The passes that belong to a back end; the others are the same code for all.
inline constexpr std::array kRenderPasses = {PassId::shadow, PassId::shade, PassId::composite};

// What the passes of one frame read. References are valid for the call.
struct RenderInput {
  const Scene& scene;
  const Methods& methods;
  const Lighting& lighting;
  const Camera& camera;
  const Pose& camera_from_marker;
  const Picture& back;  // empty: the object on transparent
  double exposure;
  // What the object lets through of its own light at each vertex, and perhaps at their backs after
  // them: of the irradiance (RGB), and of the glossy term. Empty: P_V of the scene, and all of it.
  std::span<const glm::vec4> light_shares = {};
  // What the plane's picture is multiplied by, where that is not the ratio of the shadow pass:
  // another object for another map.
  std::shared_ptr<const ShadowMap> plane_gain = nullptr;
  // What is left of the light of each vertex of the scene's holdouts, and 1. Empty: all of it.
  std::span<const glm::vec4> holdout_ratios = {};
  // Of light_shares what the map alone is kept from, where near lights or the plane change them.
  std::span<const glm::vec4> self_shares = {};
  const CellLight* cell_light = nullptr;  // that these were found with, if any
  bool shades_alike_as_one = false;       // see Plan; a GPU shades each triangle's part by itself
};

class Renderer {
 public:
  virtual ~Renderer() = default;
  virtual std::string_view backend() const = 0;
  virtual std::string device() const { return {}; }  // GL_RENDERER; empty: the processor
  // Whether it has the methods of self-shadow that find shares of single pixels.
  virtual bool shares_pixels() const = 0;
  // Runs one of kRenderPasses; throws std::invalid_argument for another.
  virtual void run(PassId pass, const RenderInput& input) = 0;
  // Forgets a product, and what its next run would follow: the ratio is 1, or nothing covers the
  // picture.
  virtual void clear(PassId pass) = 0;

  // Parts of pixels that the last run of shade worked out, where they are counted.
  virtual std::optional<double> shaded() const { return std::nullopt; }

  // Products of the last run of each pass; a GPU back end reads them back.
  virtual ShadowMap shadow_map() = 0;
  virtual ObjectLayer object() = 0;
  virtual ObjectLayer holdout() = 0;  // see holdout_layer()
  virtual Image<std::uint8_t>
  image() = 0;  // 3 channels, or 4 (straight alpha) without a back picture
};

std::unique_ptr<Renderer> make_cpu_renderer();

}  // namespace fastibl
