#include "fastibl/plan/plan.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/plan/choose_methods.h"
#include "fastibl/plan/omissions.h"

namespace fastibl {
namespace {

using namespace product;

// Products that come from outside where their pass is left out. Those of other passes left out are
// not needed.
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
      if (scene.material.reads_radiance()) reads |= radiance | near_light;
      return {id, reads, 0, object};
    }
    default:
      return {id, back_picture | pose | object | shadow | plane, 0, image};
  }
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
  if (picture_error) return std::hypot(*picture_error, kUnjudged * light_unjudged);
  double sum = 0;
  for (const PlannedPass& p : passes)
    if (p.included && p.error && p.pass.id != PassId::capture) sum += *p.error * *p.error;
  return std::sqrt(sum);
}

double Plan::assured_error() const {
  return picture_error ? picture_assured + kMostUnjudged * light_unjudged : expected_error();
}

std::optional<double> Plan::light_error() const {
  for (const PlannedPass& p : passes)
    if (p.included && p.pass.id == PassId::capture) return p.error;
  return std::nullopt;
}

bool Plan::meets_error() const {
  return error_budget == 0 || (picture_error && assured_error() <= error_budget);
}

std::optional<double> Plan::omission_bound() const {
  double sum = 0;
  for (const PlannedPass& p : passes) {
    if (p.included) continue;
    if (!p.bound) return std::nullopt;
    sum += *p.bound;
  }
  return sum;
}

namespace {

// Chooses methods by their error under this light, where it was measured and there is a budget.
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

// Why a step is left out that the chosen methods do without.
const char* why_dispensable(const PlanOptions& options, const std::optional<Choice>& choice) {
  const bool within = choice && options.error > 0 && choice->assured <= options.error;
  if (options.milliseconds > 0 && !within) return "the time budget leaves none for it";
  if (choice && options.error > 0 && !within)
    return "with it the picture comes no nearer to the error budget";
  return "the picture is within the error budget without it";
}

// Sets the error of a pass's method alone, or that of leaving the pass out in the worst view.
void set_measured_error(const Choice& choice, const MeasuredErrors& measured, PlannedPass& line) {
  const auto set = [&](const ErrorAlone& squared) {
    if (line.included)
      line.error = std::sqrt(squared.mean);
    else
      line.bound = Plan::kOmitted * std::sqrt(squared.worst);
  };
  switch (line.pass.id) {
    case PassId::irradiance:
      if (line.included) set(measured.diffuse[choice.at.diffuse]);
      return;
    case PassId::shadow:
      if (line.included) set(measured.shadow[choice.at.shadow]);
      return;
    case PassId::self_shadow:
      if (line.included || !line.bound) set(measured.self_shadow[choice.at.self_shadow]);
      return;
    case PassId::bounce:
      if (line.included || !line.bound) set(measured.bounce[choice.at.bounce]);
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

std::string shading_of(const Material& material, const Methods& methods, const Lighting* fitted) {
  std::string shading;
  if (material.pbr) {
    shading = material.reads_irradiance() ? "diffuse + ggx" : "ggx";
  } else if (material.glossy == glm::vec3(0)) {
    shading = "diffuse";
  } else {
    const std::string glossy = fitted ? described(fitted->glossy, fitted->glossy_settings)
                                      : described(methods.glossy, methods.glossy_settings);
    shading = material.diffuse == glm::vec3(0) ? "glossy (" : "diffuse + glossy (";
    shading += glossy + ")";
  }
  if (methods.self_shadow == SelfShadowMethod::traced) return shading + ", self-shadow traced";
  if (methods.self_shadow == SelfShadowMethod::traced_lights)
    return shading + ", rays to the brightest light";
  if (methods.self_shadow == SelfShadowMethod::pixel_transfer)
    return shading + ", self-shadow by pixel";
  return shading;
}

// The method of a pass, where there is a choice. fitted: the light that was fitted, or null.
std::string method_of(PassId id, const Scene& scene, const Methods& methods, const Lighting* fitted,
                      const Plan& plan) {
  switch (id) {
    case PassId::track:
      return std::string(name(methods.tracking == TrackingMethod::automatic ? TrackingMethod::edges
                                                                            : methods.tracking));
    case PassId::capture:
      return std::string(name(methods.capture));
    case PassId::irradiance:
      return fitted ? described(fitted->irradiance.method, fitted->irradiance.settings)
                    : described(methods.diffuse, methods.diffuse_settings);
    case PassId::shadow:
      return described(scene.shadow_method(methods.shadow), methods.shadow_settings);
    case PassId::self_shadow:
      return std::string(name(shares_by_pixel(methods.self_shadow) ? methods.self_shadow
                                                                   : SelfShadowMethod::transfer));
    case PassId::near_light:
      return "spheres";
    case PassId::bounce:
      return std::string(name(BounceMethod::one));
    case PassId::plane:
      if (!plan.includes(PassId::bounce)) return "strength and colour";
      return scene.shadow_look.changes() ? "bounce, strength and colour" : "bounce";
    case PassId::holdout:
      return "rays";
    case PassId::shade:
      return shading_of(scene.material, methods, fitted);
    default:
      return "";
  }
}

// With what `automatic` stands for, as far as that is known.
Methods resolved(Methods methods, const Scene& scene, const Lighting* fitted) {
  methods.shadow = scene.shadow_method(methods.shadow);
  if (fitted && fitted->has_irradiance)
    methods.diffuse = fitted->irradiance.method,
    methods.diffuse_settings = fitted->irradiance.settings;
  if (fitted && fitted->radiance)
    methods.glossy = fitted->glossy, methods.glossy_settings = fitted->glossy_settings;
  return methods;
}

double frame_milliseconds(const Plan& plan, const Workload& work) {
  double each = 0, picture = 0, light = 0;
  for (const PlannedPass& p : plan.passes) {
    if (!p.milliseconds) continue;
    const double time = *p.milliseconds * runs_per_frame(p.pass.id, work);
    switch (p.pass.id) {
      case PassId::capture:
        picture = time / work.cameras;
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
  return each + (plan.light_in_turns ? std::max(picture, light) : work.cameras * picture + light);
}

}  // namespace

Plan make_plan(const Scene& scene, const Environment* environment, const PlanOptions& options) {
  check_budgets(options.error, options.milliseconds);
  Plan plan;
  plan.methods = options.methods;
  Workload work = options.workload;
  if (options.object) work.object = *options.object;
  if (options.lighting && options.lighting->chain)
    work.lights = int(options.lighting->chain->lights.size());
  Workload usual = options.workload;
  if (options.measured) work.rays = usual.rays = options.measured->rays;
  const std::optional<Choice> choice =
      chosen(scene, options, options.milliseconds > 0 ? work : usual);
  if (choice) {
    plan.methods = choice->methods;
    plan.picture_error = choice->error, plan.best_error = choice->best_error;
    plan.picture_assured = choice->assured, plan.best_assured = choice->best_assured;
    plan.light_unjudged = options.light_unjudged;
    if (const auto& left = options.measured->sampling) plan.sampling_error = std::sqrt(*left);
  }
  const char* dispensable = why_dispensable(options, choice);
  const Methods& methods = plan.methods;
  plan.error_budget = options.error, plan.milliseconds_budget = options.milliseconds;
  // The nearest face of the paper's look-up may be another one there.
  const bool budget = options.error > 0 || options.milliseconds > 0;
  plan.shades_alike_as_one = budget &&
                             (options.error == 0 || options.error >= Plan::kLeastForOne) &&
                             methods.diffuse != DiffuseMethod::nearest_face;
  // Where methods were chosen, they go by what was measured; otherwise they are those of the light.
  const Lighting* fitted = choice ? nullptr : options.lighting;
  const Methods priced = resolved(methods, scene, fitted);
  for (const PassId id : kPasses) {
    Omission omission = omission_of(id, scene, environment, options, plan, dispensable);
    PlannedPass line{pass_of(id, scene), omission.reason.empty()};
    line.reason = std::move(omission.reason), line.bound = omission.bound;
    line.method = method_of(id, scene, methods, fitted, plan);
    if (id == PassId::capture && environment && options.capture)
      line.error = std::hypot(environment->predicted_error, options.light_lag);
    if (id == PassId::irradiance && fitted) line.error = fitted->irradiance_error;
    if (choice) set_measured_error(*choice, *options.measured, line);
    line.milliseconds = pass_milliseconds(options.costs, id, priced, work) * options.slowdown;
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
  Products unused = 0;  // what no pass makes now; it stays old until its pass is back
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
