#include "fastibl/plan/plan.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/plan/choose_methods.h"

namespace fastibl {
namespace {

using namespace product;

// What comes from outside where its pass is left out; of other passes left out there is no need.
constexpr Products kGivable = pose | texels | radiance;

Pass pass_of(PassId id, const Scene& scene) {
  switch (id) {
    case PassId::track:
      return {id, back_picture, 0, pose};
    case PassId::capture:
      return {id, light_pictures, pose, texels};
    case PassId::mips:
      return {id, texels, 0, radiance};
    case PassId::irradiance:
      return {id, radiance, 0, irradiance};
    case PassId::shadow:
      return {id, radiance | irradiance | placement, 0, shadow};
    case PassId::self_shadow:
      return {id, radiance | irradiance | placement, 0, self_shadow};
    case PassId::near_light:
      return {id, radiance | irradiance | placement, 0, near_light};
    case PassId::bounce:
      return {id,
              radiance | irradiance | placement | material | shadow | product::self_shadow |
                  product::near_light,
              0, bounce};
    case PassId::plane:
      return {id, shadow | bounce, 0, plane};
    case PassId::holdout:
      return {id, radiance | irradiance | placement, 0, holdout};
    case PassId::shade: {
      Products reads = holdout | pose | placement | material;
      if (scene.material.reads_irradiance())
        reads |= irradiance | self_shadow | near_light | bounce;
      if (scene.material.reads_radiance()) reads |= radiance;
      return {id, reads, 0, object};
    }
    default:
      return {id, back_picture | pose | object | shadow | plane, 0, image};
  }
}

// Why the self-shadow is not worked out from the light; empty where it is.
std::string no_transfer(const Scene& scene) {
  if (!scene.directions) return "what the object hides was not worked out";
  if (scene.directions->blocks_nothing()) return "the object hides nothing of itself";
  if (!scene.material.reads_irradiance()) return "k_L = 0: nothing reads it";
  return "";
}

glm::dvec3 mean_of(const CubeMap& map) {
  constexpr int kEnough = 16;  // for a bound: levels have the same mean
  return map.level_at_most(kEnough).mean();
}

// What leaving out the bounce does to the plane's picture and the object's, by the light of the
// plane: an object that reflects ρ of its light, at most 4π times the map's mean, sends the plane
// at most all of it; a plane of the radiance that it is seen with lights the object by at most π
// times that. Nothing where the light is not known.
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

// A share of the error budget that leaving the bounce out may take.
constexpr double kBounceBudget = 0.1;

std::string no_bounce(const Scene& scene, const PlanOptions& options, double& bound) {
  if (!options.cast_shadow || !scene.casts_shadow()) return "there is no shadow to go with it";
  if (!scene.directions) return "what the object hides was not worked out";
  const std::optional<double> most = bounce_bound(scene, options.lighting);
  if (!most || *most > kBounceBudget * options.error) return "";
  bound = *most;
  return bound == 0 ? "the object sends out no diffuse light" : "the object is too dark to matter";
}

// A share of the error budget that leaving the places of near lights out may take.
constexpr double kNearBudget = 0.1;

// What leaving out the places of near lights does to the irradiance of the object, by the mean
// irradiance over all normals, π times the map's mean; see most_change().
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

// Why the lights are taken as distant; empty where they are not.
std::string no_near_light(const Scene& scene, const Environment* environment,
                          const PlanOptions& options, double& bound) {
  if (!scene.material.reads_irradiance()) return "k_L = 0: nothing reads it";
  const Lighting* lighting = options.lighting;
  const bool known = lighting && lighting->radiance;
  if (known ? lighting->near_lights.empty() : !environment || environment->light_positions.empty())
    return "no light is known to be near";
  if (!known) return "";
  const double most = near_bound(scene, *lighting);
  if (!(most <= kNearBudget * options.error)) return "";
  bound = most;
  return "the lights are too far, or too weak, to differ over the object";
}

}  // namespace

std::string_view name(PassId id) {
  constexpr std::array names = {"track",  "capture",     "mips",       "irradiance",
                                "shadow", "self_shadow", "near_light", "bounce",
                                "plane",  "holdout",     "shade",      "composite"};
  return names[std::size_t(id)];
}

bool Plan::includes(PassId id) const {
  for (const PlannedPass& p : passes)
    if (p.pass.id == id) return p.included;
  return false;
}

double Plan::expected_error() const {
  if (picture_error) return *picture_error;
  double sum = 0;
  for (const PlannedPass& p : passes)
    if (p.included && p.error && p.pass.id != PassId::capture) sum += *p.error * *p.error;
  return std::sqrt(sum);
}

double Plan::assured_error() const { return picture_error ? picture_assured : expected_error(); }

std::optional<double> Plan::light_error() const {
  for (const PlannedPass& p : passes)
    if (p.included && p.pass.id == PassId::capture) return p.error;
  return std::nullopt;
}

bool Plan::meets_error() const {
  return error_budget == 0 || (picture_error && picture_assured <= error_budget);
}

double Plan::omission_bound() const {
  double sum = 0;
  for (const PlannedPass& p : passes)
    if (!p.included) sum += p.bound;
  return sum;
}

namespace {

constexpr const char* kWithinBudget = "the picture is within the error budget without it";
constexpr const char* kNoHelp = "with it the picture comes no nearer to the error budget";
constexpr const char* kNoTime = "the time budget leaves none for it";

// Methods by what they leave wrong under this light, where that was measured and there is a budget.
std::optional<Choice> chosen(const Scene& scene, const PlanOptions& options, const Workload& work) {
  if (!options.measured || options.measured->empty()) return std::nullopt;
  if (options.error == 0 && options.milliseconds == 0) return std::nullopt;
  ChoiceOptions choice;
  choice.error = options.error, choice.milliseconds = options.milliseconds;
  choice.assurance = Plan::kAssurance, choice.slowdown = options.slowdown;
  choice.keep = options.keep, choice.settled = options.settled;
  choice.transfer = no_transfer(scene).empty();
  choice.cast_shadow = options.cast_shadow && scene.casts_shadow();
  const auto other = [&](PassId id) {
    choice.other_milliseconds +=
        pass_milliseconds(options.costs, id, options.methods, work) * runs_per_frame(id, work);
  };
  other(PassId::composite);
  if (options.track) other(PassId::track);
  if (options.capture) other(PassId::capture), other(PassId::mips);
  return choose_methods(options.methods, *options.measured, options.costs, work, choice);
}

// What a pass's method alone leaves wrong, or what leaving the pass out does.
void set_measured_error(const Choice& choice, const MeasuredErrors& measured, const Methods& asked,
                        PlannedPass& line) {
  const auto set = [&](double squared) {
    (line.included ? line.error.emplace() : line.bound) = std::sqrt(squared);
  };
  switch (line.pass.id) {
    case PassId::irradiance:
      if (line.included) set(measured.diffuse[choice.at.diffuse]);
      return;
    case PassId::shadow:
      if (line.included) set(measured.shadow[choice.at.shadow]);
      return;
    case PassId::self_shadow:
      // What was asked for is no error.
      if (line.included || (asked.self_shadow == SelfShadowMethod::automatic &&
                            !knows_directions(choice.methods.self_shadow)))
        set(measured.self_shadow[choice.at.self_shadow]);
      return;
    case PassId::bounce:
      if (line.included || (asked.bounce == BounceMethod::automatic && line.bound == 0 &&
                            choice.methods.bounce == BounceMethod::none))
        set(measured.bounce[choice.at.bounce]);
      return;
    case PassId::shade:
      if (line.included) set(measured.glossy[choice.at.glossy]);
      return;
    default:
      return;
  }
}

}  // namespace

CandidateOptions candidate_options(const Scene& scene, const Environment& environment) {
  CandidateOptions options;
  options.baked_shadow = scene.baked_shadow != nullptr;
  options.glossy = scene.material.reads_radiance();
  options.pbr = scene.material.pbr != nullptr;
  options.boxed = environment.box.has_value();
  options.placed = !environment.light_positions.empty();
  return options;
}

void check_budgets(double error, double milliseconds) {
  check(error >= 0 && error <= 1,
        "an error budget must be a share, from 0 (none) to 1 (0.02 is 2 %), got ", error);
  check(milliseconds >= 0 && std::isfinite(milliseconds),
        "a time budget must be milliseconds from 0 (none) on, got ", milliseconds);
}

namespace {

double frame_milliseconds(const Plan& plan, const Workload& work) {
  double each = 0, picture = 0, light = 0;
  for (const PlannedPass& p : plan.passes) {
    if (!p.milliseconds) continue;
    const double time = *p.milliseconds * runs_per_frame(p.pass.id, work);
    switch (p.pass.id) {
      case PassId::capture:
        picture = time / 2;  // of two cameras
        break;
      case PassId::track:
      case PassId::shade:
      case PassId::composite:
        each += time;
        break;
      default:
        light += time;
    }
  }
  return each + (plan.light_in_turns ? std::max(picture, light) : 2 * picture + light);
}

}  // namespace

Plan make_plan(const Scene& scene, const Environment* environment, const PlanOptions& options) {
  check_budgets(options.error, options.milliseconds);
  Plan plan;
  plan.methods = options.methods;
  Workload work = options.workload;
  if (options.object_pixels) work.object_pixels = *options.object_pixels;
  if (options.lighting && options.lighting->chain)
    work.lights = int(options.lighting->chain->lights.size());
  const std::optional<Choice> choice =
      chosen(scene, options, options.milliseconds > 0 ? work : options.workload);
  if (choice) {
    plan.methods = choice->methods;
    plan.picture_error = choice->error, plan.best_error = choice->best_error;
    plan.picture_assured = choice->assured, plan.best_assured = choice->best_assured;
  }
  const bool within = choice && options.error > 0 && choice->assured <= options.error;
  const char* dispensable = options.milliseconds > 0 && !within      ? kNoTime
                            : choice && options.error > 0 && !within ? kNoHelp
                                                                     : kWithinBudget;
  const Methods& methods = plan.methods;
  plan.error_budget = options.error, plan.milliseconds_budget = options.milliseconds;
  // The nearest face of the paper's look-up may be another one there.
  const bool budget = options.error > 0 || options.milliseconds > 0;
  plan.shades_alike_as_one = budget &&
                             (options.error == 0 || options.error >= Plan::kLeastForOne) &&
                             methods.diffuse != DiffuseMethod::nearest_face;
  for (const PassId id : kPasses) {
    PlannedPass line{pass_of(id, scene), true, "", "", 0, std::nullopt};
    const auto leave_out = [&](std::string reason) {
      line.included = false, line.reason = std::move(reason);
    };
    switch (id) {
      case PassId::track:
        line.method = name(methods.tracking == TrackingMethod::automatic ? TrackingMethod::edges
                                                                         : methods.tracking);
        if (!options.track) leave_out("poses are given");
        break;
      case PassId::capture:
        line.method = name(methods.capture);
        if (environment && options.capture)
          line.error = std::hypot(environment->predicted_error, options.light_lag);
        if (!options.capture) leave_out("the environment is given");
        break;
      case PassId::mips:
        if (!options.capture) leave_out("the environment is given with its chain");
        break;
      case PassId::irradiance: {
        line.method = described(methods.diffuse, methods.diffuse_settings);
        if (const Lighting* l = options.lighting; l && !choice) {
          line.method = described(l->irradiance.method, l->irradiance.settings);
          line.error = l->irradiance_error;
        }
        const bool lit = scene.material.reads_irradiance();
        const bool shadowed = options.cast_shadow && (scene.casts_shadow() || scene.has_holdouts());
        if (!lit && !shadowed) leave_out("k_L = 0 and no shadow: nothing reads it");
        break;
      }
      case PassId::shadow:
        line.method = described(scene.shadow_method(methods.shadow), methods.shadow_settings);
        if (!options.cast_shadow)
          leave_out("no shadow was asked for");
        else if (!scene.casts_shadow())
          leave_out("the object has no spheres");
        break;
      case PassId::self_shadow:
        line.method = name(shares_by_pixel(methods.self_shadow) ? methods.self_shadow
                                                                : SelfShadowMethod::transfer);
        if (const std::string reason = no_transfer(scene); !reason.empty())
          leave_out(reason);
        else if (methods.self_shadow == SelfShadowMethod::none)
          leave_out(options.methods.self_shadow == methods.self_shadow
                        ? "no self-shadow was asked for"
                        : dispensable);
        else if (methods.self_shadow == SelfShadowMethod::ambient)
          leave_out("P_V of the mesh stands for it, whatever the light");
        break;
      case PassId::near_light:
        line.method = "spheres";
        if (const std::string reason = no_near_light(scene, environment, options, line.bound);
            !reason.empty())
          leave_out(reason);
        break;
      case PassId::bounce:
        line.method = name(BounceMethod::one);
        if (options.methods.bounce == BounceMethod::none)
          leave_out("no bounce was asked for");
        else if (const std::string reason = no_bounce(scene, options, line.bound); !reason.empty())
          leave_out(reason);
        else if (methods.bounce == BounceMethod::none)
          leave_out(dispensable);
        break;
      case PassId::plane: {
        const bool bounced = plan.includes(PassId::bounce), look = scene.shadow_look.changes();
        line.method =
            bounced ? look ? "bounce, strength and colour" : "bounce" : "strength and colour";
        if (!options.cast_shadow || !scene.casts_shadow())
          leave_out("there is no shadow");
        else if (!bounced && !look)
          leave_out("the shadow is drawn as it is");
        break;
      }
      case PassId::holdout:
        line.method = "rays";
        if (!scene.has_holdouts())
          leave_out("no real objects were given");
        else if (!options.cast_shadow)
          leave_out("no shadow was asked for");
        break;
      case PassId::shade: {
        const Material& m = scene.material;
        const char* by_pixel =
            methods.self_shadow == SelfShadowMethod::traced           ? ", self-shadow traced"
            : methods.self_shadow == SelfShadowMethod::pixel_transfer ? ", self-shadow by pixel"
                                                                      : "";
        if (m.pbr) {
          line.method = m.reads_irradiance() ? "diffuse + ggx" : "ggx";
          line.method += by_pixel;
          break;
        }
        line.method = m.glossy == glm::vec3(0)    ? "diffuse"
                      : m.diffuse == glm::vec3(0) ? "glossy"
                                                  : "diffuse + glossy";
        if (m.glossy != glm::vec3(0))
          line.method +=
              " (" +
              (options.lighting && !choice
                   ? described(options.lighting->glossy, options.lighting->glossy_settings)
                   : described(methods.glossy, methods.glossy_settings)) +
              ")";
        line.method += by_pixel;
        break;
      }
      default:
        break;
    }
    if (choice) set_measured_error(*choice, *options.measured, options.methods, line);
    line.milliseconds = pass_milliseconds(options.costs, id, methods, work) * options.slowdown;
    if (*line.milliseconds == 0 || !line.included) line.milliseconds.reset();
    line.once = runs_per_frame(id, work) < 1;
    plan.passes.push_back(std::move(line));
  }
  plan.light_in_turns = options.light_in_turns;
  plan.milliseconds = frame_milliseconds(plan, work);
  return plan;
}

std::vector<PassId> due_passes(const Plan& plan, Products wanted, Products& stale) {
  Products needed = wanted;
  for (auto p = plan.passes.rbegin(); p != plan.passes.rend(); ++p)
    if (p->included && (p->pass.writes & needed)) needed |= p->pass.reads | p->pass.needs;
  std::vector<PassId> due;
  Products unused = 0;  // what nobody makes now; it stays old until its pass is back
  for (const PlannedPass& p : plan.passes) {
    if (!p.included && (p.pass.writes & kGivable)) continue;
    if (p.pass.reads & stale & ~unused) stale |= p.pass.writes;
    if (!p.included) unused |= p.pass.writes;
  }
  for (const PlannedPass& p : plan.passes)
    if (p.included && (p.pass.writes & stale) && (p.pass.writes & needed)) due.push_back(p.pass.id);
  for (const PlannedPass& p : plan.passes)
    for (const PassId id : due)
      if (p.pass.id == id) stale &= ~p.pass.writes;
  // Inputs have had their effect; so has what comes from outside in place of a pass left out.
  stale &= ~product::inputs;
  for (const PlannedPass& p : plan.passes)
    if (!p.included) stale &= ~(p.pass.writes & kGivable);
  return due;
}

}  // namespace fastibl
