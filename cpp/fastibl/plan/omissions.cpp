#include "fastibl/plan/omissions.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

namespace fastibl {
namespace {

constexpr const char* kUnread = "k_L = 0: nothing reads it";
constexpr const char* kNoShadowAsked = "no shadow was asked for";
constexpr const char* kNotWorkedOut = "what the object hides was not worked out";

glm::dvec3 mean_of(const CubeMap& map) {
  constexpr int kEnough = 16;  // for a bound: levels have the same mean
  return map.level_at_most(kEnough).mean();
}

// How much leaving out the bounce changes the pictures of the plane and the object, relative to the
// plane's light. An object that reflects ρ of its light, at most 4π times the map's mean, sends the
// plane at most all of it. A plane lights the object by at most π times the radiance that it is
// seen with. Nothing where the light is not known.
std::optional<double> bounce_bound(const Scene& scene, const Lighting* lighting) {
  const Material& m = scene.material;
  const glm::vec3 sent = !m.pbr ? m.diffuse + (m.exponent == 0 ? m.glossy : glm::vec3(0))
                         : m.pbr->metallic < 1 || m.pbr->metallic_map ? m.pbr->base_color
                                                                      : glm::vec3(0);
  glm::vec3 emission = m.pbr ? m.pbr->emission : m.emission;
  if (m.pbr && m.pbr->emission_map) emission *= m.pbr->emission_map->largest();
  if (sent == glm::vec3(0) && emission == glm::vec3(0)) return 0.0;
  if (!lighting || !lighting->radiance) return std::nullopt;
  const glm::dvec3 mean = mean_of(*lighting->radiance);
  double bound = 0;
  for (int c = 0; c < 3; ++c) {
    const double plane = lighting->plane_irradiance[c];
    const double received = 4 * double(kPi) * (sent[c] * mean[c]) + double(kPi) * emission[c];
    if (received > 0 && !(plane > 0)) return std::nullopt;
    if (plane > 0) bound = std::max({bound, double(sent[c]), received / plane});
  }
  return bound;
}

// The same where pictures were judged: a picture that shows little but a dark object is as dark,
// and is changed by as large a part as a bright one.
std::optional<double> judged_bounce(const MeasuredErrors* measured) {
  if (!measured || measured->empty()) return std::nullopt;
  const std::vector<BounceMethod>& methods = measured->candidates.bounce;
  const auto none = std::find(methods.begin(), methods.end(), BounceMethod::none);
  if (none == methods.end()) return std::nullopt;
  return Plan::kOmitted * std::sqrt(measured->bounce[std::size_t(none - methods.begin())].worst);
}

// A share of the error budget that leaving the bounce out may take.
constexpr double kBounceBudget = 0.1;

Omission of_bounce(const Scene& scene, const PlanOptions& options, const Methods& methods,
                   const char* dispensable) {
  std::optional<double> bound = bounce_bound(scene, options.lighting);
  if (!options.cast_shadow || !scene.casts_shadow())
    return {"there is no shadow to go with it", bound == 0.0 ? bound : std::nullopt};
  if (bound && *bound > 0) bound = std::max(*bound, judged_bounce(options.measured).value_or(0));
  if (bound && *bound <= kBounceBudget * options.error)
    return {
        *bound == 0 ? "the object sends out no diffuse light" : "the object is too dark to matter",
        *bound};
  if (!scene.directions) return {kNotWorkedOut, std::nullopt};
  if (methods.bounce != BounceMethod::none) return {};
  const bool asked = options.methods.bounce == BounceMethod::none;
  return {asked ? "no bounce was asked for" : dispensable, std::nullopt};
}

// How much a shadow that is not cast changes: nothing below the plane, else nobody knows.
std::optional<double> unshadowed(const Scene& scene) {
  for (const glm::vec3& p : scene.mesh.vertices)
    if ((scene.marker_from_object * glm::dvec3(p)).z > 0) return std::nullopt;
  return 0.0;
}

// A share of the error budget that leaving out the places of near lights may take.
constexpr double kNearBudget = 0.1;

// How much leaving out the places of near lights changes the object's irradiance, relative to the
// mean irradiance over all normals, π times the map's mean; see most_change().
double near_bound(const Scene& scene, const Lighting& lighting) {
  const Bounds box = bounds(scene.mesh.vertices);
  const glm::vec3 middle(scene.marker_from_object * glm::dvec3(box.centre()));
  const float reach = glm::length(middle - lighting.near_lights.centre) + box.radius();
  const glm::vec3 change = most_change(lighting.near_lights, reach);
  const glm::dvec3 mean = mean_of(*lighting.radiance);
  double bound = 0;
  for (int c = 0; c < 3; ++c)
    if (change[c] > 0) bound = std::max(bound, double(change[c]) / (double(kPi) * mean[c]));
  return bound;
}

Omission of_near_light(const Scene& scene, const Environment* environment,
                       const PlanOptions& options, const Methods& methods) {
  // Glossy light is placed where it is looked up; here it is found what hides it there.
  const bool hidden = knows_directions(methods.self_shadow) && scene.material.lobe() &&
                      scene.directions && !scene.directions->blocks_nothing();
  if (!scene.material.reads_irradiance() && !hidden) return {kUnread};
  const Lighting* lighting = options.lighting;
  const bool known = lighting && lighting->radiance;
  if (known ? lighting->near_lights.empty() : !environment || environment->light_positions.empty())
    return {"no light is known to be near"};
  if (!known) return {};
  const double bound = near_bound(scene, *lighting);
  if (bound <= kNearBudget * options.error)
    return {"the lights are too far, or too weak, to differ over the object", bound};
  return {};
}

Omission of_irradiance(const Scene& scene, const PlanOptions& options) {
  const bool lit = scene.material.reads_irradiance();
  const bool shadowed = options.cast_shadow && (scene.casts_shadow() || scene.has_holdouts());
  if (lit || shadowed) return {};
  return {"k_L = 0 and no shadow: nothing reads it"};
}

Omission of_self_shadow(const Scene& scene, const PlanOptions& options, const Methods& methods,
                        const char* dispensable) {
  const bool lit = scene.material.reads_irradiance() || scene.material.reads_radiance();
  const bool hides = !scene.directions || !scene.directions->blocks_nothing();
  const bool missing = lit && hides && !(scene.directions && knows_directions(methods.self_shadow));
  const std::optional<double> bound = missing ? std::nullopt : std::optional(0.0);
  if (std::string reason = no_transfer(scene); !reason.empty()) return {std::move(reason), bound};
  if (methods.self_shadow == SelfShadowMethod::ambient)
    return {"P_V of the mesh stands for it, whatever the light", bound};
  if (methods.self_shadow != SelfShadowMethod::none) return {};
  const bool asked = options.methods.self_shadow == SelfShadowMethod::none;
  return {asked ? "no self-shadow was asked for" : dispensable, bound};
}

}  // namespace

std::string no_transfer(const Scene& scene) {
  if (!scene.directions) return kNotWorkedOut;
  if (scene.directions->blocks_nothing()) return "the object hides nothing of itself";
  if (!scene.material.reads_irradiance()) return kUnread;
  return "";
}

Omission omission_of(PassId id, const Scene& scene, const Environment* environment,
                     const PlanOptions& options, const Plan& plan, const char* dispensable) {
  switch (id) {
    case PassId::track:
      if (!options.track) return {"poses are given"};
      break;
    case PassId::capture:
      if (!options.capture) return {"the environment is given"};
      break;
    case PassId::mips:
      if (!options.capture) return {"the environment is given with its chain"};
      break;
    case PassId::irradiance:
      return of_irradiance(scene, options);
    case PassId::shadow:
      if (!options.cast_shadow) return {kNoShadowAsked, unshadowed(scene)};
      if (!scene.casts_shadow()) return {"the object has no spheres", unshadowed(scene)};
      break;
    case PassId::self_shadow:
      return of_self_shadow(scene, options, plan.methods, dispensable);
    case PassId::near_light:
      return of_near_light(scene, environment, options, plan.methods);
    case PassId::bounce:
      return of_bounce(scene, options, plan.methods, dispensable);
    case PassId::plane:
      if (!options.cast_shadow || !scene.casts_shadow()) return {"there is no shadow"};
      if (!plan.includes(PassId::bounce) && !scene.shadow_look.changes())
        return {"the shadow is drawn as it is"};
      break;
    case PassId::holdout:
      if (!scene.has_holdouts()) return {"no real objects were given"};
      if (!options.cast_shadow) return {kNoShadowAsked, std::nullopt};
      break;
    default:
      break;
  }
  return {};
}

}  // namespace fastibl
