// How objects change the light that the map gives to the scene's own object, to the plane around
// it, and to the holdouts. Keeps what stays valid from one map to the next.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/scene.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/scene/vertex_visibility.h"
#include "fastibl/shading/bounce.h"
#include "fastibl/shading/near_shares.h"
#include "fastibl/shading/plane_exchange.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

// Finds the shares that RenderInput takes; each find_…() is a pass of the plan.
class LightShares {
 public:
  void forget_object();  // another object comes
  // Forgets what was found for a map and by other methods: the shares become those of `method`
  // without a map.
  void clear(const Scene& scene, SelfShadowMethod method);
  void clear_near() { near_.clear(); }
  void clear_bounce() { bounce_ = {}, plane_gain_ = nullptr; }
  void clear_gain() { plane_gain_ = nullptr; }

  void find_diffuse(const Scene& scene, const Lighting& lighting);
  void find_near(const Scene& scene, const Lighting& lighting, SelfShadowMethod method);
  void find_bounce(const Scene& scene, const Lighting& lighting, const ShadowMap& shadow);
  void find_plane_gain(const Scene& scene, const ShadowMap& shadow);
  // Cuts the scene's holdouts anew where the object has been moved away from their middle.
  void find_holdouts(Scene& scene, const Lighting& lighting);
  // Call for every view anew; adds what near lights and the bounce change. radiance: null before
  // there is a map.
  void find_glossy(const Scene& scene, const CubeMap* radiance, SelfShadowMethod method,
                   const Pose& camera_from_marker);

  // Finds the form factors for the bounce, which hold until the object is tilted or lifted.
  void place_exchange(const Scene& scene);
  // Groups of triangles that the exchange is summed over; nothing before place_exchange().
  std::optional<std::size_t> groups() const;

  std::span<const glm::vec4> all() const { return changes() ? changed_ : own_; }
  std::span<const glm::vec4> own() const { return own_; }  // without near lights and the bounce
  const NearShares* near_shares() const { return near_.empty() ? nullptr : &near_maker_; }
  const CellLight& cell_light() const { return cell_light_; }
  const std::shared_ptr<const ShadowMap>& plane_gain() const { return plane_gain_; }
  std::span<const glm::vec4> holdouts() const { return holdouts_; }

 private:
  bool changes() const { return !bounce_.empty() || !near_.empty(); }
  void update_cell_light(const Scene& scene, const CubeMap& radiance);
  std::vector<glm::vec4> by_side(const Scene& scene) const;

  CellLight cell_light_;
  std::vector<glm::vec4> own_;
  NearShares near_maker_;
  std::vector<glm::vec3> near_;            // what near lights change
  std::optional<PlaneExchange> exchange_;  // for the object as it stood last
  Bounce bounce_;
  std::vector<glm::vec4> changed_;
  std::shared_ptr<const ShadowMap> plane_gain_;
  std::optional<Pose> hidden_from_;  // where the object stood
  VertexVisibility hidden_;          // what the object hides from the holdouts
  CellLight holdout_light_;
  std::vector<glm::vec4> holdouts_;
};

}  // namespace fastibl
