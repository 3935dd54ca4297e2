#include "fastibl/render/light_shares.h"

#include <cmath>
#include <glm/gtc/constants.hpp>

#include "fastibl/shading/glossy_shares.h"
#include "fastibl/shading/holdout.h"
#include "fastibl/shading/near_lobes.h"

namespace fastibl {
namespace {

constexpr int kBounceCells = 32;  // of the plane, along an edge

// The pose without what it turns about z and shifts along the plane: cells lie by the object,
// wherever it was when they were made.
Pose unturned(const Pose& marker_from_object) {
  const glm::dmat3& r = marker_from_object.rotation;
  // The axis that lies flattest tells the turn.
  const int axis = std::abs(r[0].z) <= std::abs(r[1].z) ? 0 : 1;
  const double yaw = std::atan2(r[axis].y, r[axis].x) - (axis == 0 ? 0 : glm::half_pi<double>());
  const glm::dmat3 back(glm::dvec3(std::cos(yaw), -std::sin(yaw), 0),
                        glm::dvec3(std::sin(yaw), std::cos(yaw), 0), glm::dvec3(0, 0, 1));
  return {back * r, {0, 0, marker_from_object.translation.z}};
}

}  // namespace

void LightShares::forget_object() {
  cell_light_ = {}, holdout_light_ = {}, near_maker_ = {};
  exchange_.reset(), hidden_from_.reset();
}

// The paper's P_V is read from the scene, so there is nothing to keep for it.
void LightShares::clear(const Scene& scene, SelfShadowMethod method) {
  own_.clear();
  if (method == SelfShadowMethod::none)
    own_.assign(scene.mesh.vertices.size(), glm::vec4(1));
  else if (method != SelfShadowMethod::ambient && scene.directions)
    own_.assign(scene.directions->entries(), glm::vec4(1));
  clear_near();
  clear_bounce();
  holdouts_.clear();
}

void LightShares::update_cell_light(const Scene& scene, const CubeMap& radiance) {
  const glm::mat3 marker_from_object(scene.marker_from_object.rotation);
  cell_light_.update(radiance, glm::transpose(marker_from_object), scene.directions->size);
}

void LightShares::find_diffuse(const Scene& scene, const Lighting& lighting) {
  update_cell_light(scene, *lighting.radiance);
  diffuse_shares(*scene.directions, cell_light_, lighting.irradiance, scene.normals,
                 glm::mat3(scene.marker_from_object.rotation), own_);
}

void LightShares::find_near(const Scene& scene, const Lighting& lighting, SelfShadowMethod method) {
  const SharesOf of = method == SelfShadowMethod::ambient ? SharesOf::visibility
                      : knows_directions(method)          ? SharesOf::directions
                                                          : SharesOf::all;
  near_ = near_maker_.update(scene, lighting, of);
}

void LightShares::place_exchange(const Scene& scene) {
  if (!exchange_ || !exchange_->motion(scene.marker_from_object))
    exchange_.emplace(scene.mesh, *scene.directions, kBounceCells,
                      unturned(scene.marker_from_object));
}

std::optional<std::size_t> LightShares::groups() const {
  if (!exchange_) return std::nullopt;
  return exchange_->groups();
}

// The shares of the map's light, by side where both are seen: near lights and the bounce change the
// sides differently.
std::vector<glm::vec4> LightShares::by_side(const Scene& scene) const {
  std::vector<glm::vec4> shares = own_;
  if (shares.empty())
    for (const float v : scene.visibility) shares.emplace_back(glm::vec3(v), 1);
  const std::size_t vertices = scene.mesh.vertices.size();
  while (shares.size() < vertices * std::size_t(scene.sides()))
    shares.push_back(shares[shares.size() - vertices]);
  return shares;
}

void LightShares::find_bounce(const Scene& scene, const Lighting& lighting,
                              const ShadowMap& shadow) {
  place_exchange(scene);
  if (near_.empty()) {
    bounce_ = fastibl::find_bounce(*exchange_, scene, lighting, shadow, own_);
    return;
  }
  std::vector<glm::vec4> shares = by_side(scene);
  add_shares(near_, shares);
  bounce_ = fastibl::find_bounce(*exchange_, scene, lighting, shadow, shares);
}

void LightShares::find_plane_gain(const Scene& scene, const ShadowMap& shadow) {
  plane_gain_ =
      std::make_shared<const ShadowMap>(fastibl::plane_gain(shadow, scene.shadow_look, bounce_));
}

void LightShares::find_glossy(const Scene& scene, const CubeMap* radiance, SelfShadowMethod method,
                              const Pose& camera_from_marker) {
  const std::optional<LobeShape> lobe = scene.material.lobe();
  if (knows_directions(method) && lobe && radiance && scene.directions &&
      !scene.directions->blocks_nothing()) {
    update_cell_light(scene, *radiance);
    const Pose object_from_camera = (camera_from_marker * scene.marker_from_object).inverse();
    std::optional<NearLobes> near_lobes;
    if (!near_.empty())
      near_lobes.emplace(scene, near_maker_, cell_light_,
                         glm::vec3(radiance->level_at_most(16).mean()), *lobe);
    glossy_shares(*scene.directions, cell_light_, *lobe, scene.mesh.vertices, scene.normals,
                  glm::vec3(object_from_camera.translation), own_,
                  near_lobes ? &*near_lobes : nullptr);
  }
  if (!changes()) return;
  changed_ = by_side(scene);
  if (!near_.empty()) add_shares(near_, changed_);
  if (!bounce_.empty()) add_shares(bounce_, changed_);
}

void LightShares::find_holdouts(Scene& scene, const Lighting& lighting) {
  if (hidden_from_ != scene.marker_from_object) {
    follow_object(scene);
    hidden_ = hidden_by_object(scene);
    hidden_from_ = scene.marker_from_object;
  }
  holdouts_ = holdout_ratios(scene, hidden_, lighting, holdout_light_);
  if (!scene.shadow_look.changes()) return;
  for (glm::vec4& ratio : holdouts_)
    ratio = glm::vec4(scene.shadow_look.apply(glm::vec3(ratio)), 1);
}

}  // namespace fastibl
