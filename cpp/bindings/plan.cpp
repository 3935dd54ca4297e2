#include "fastibl/plan/plan.h"

#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "bindings/costs.h"
#include "bindings/numpy.h"
#include "fastibl/core/check.h"
#include "fastibl/core/clock.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/plan/bill.h"
#include "fastibl/render/measure_costs.h"
#include "fastibl/render/measure_errors.h"
#include "fastibl/render/workload.h"

namespace fastibl::bindings {
namespace {

constexpr std::pair<const char*, Products> kProducts[] = {
    {"back_picture", product::back_picture},
    {"light_pictures", product::light_pictures},
    {"placement", product::placement},
    {"material", product::material},
    {"pose", product::pose},
    {"texels", product::texels},
    {"radiance", product::radiance},
    {"irradiance", product::irradiance},
    {"shadow", product::shadow},
    {"self_shadow", product::self_shadow},
    {"near_light", product::near_light},
    {"bounce", product::bounce},
    {"plane", product::plane},
    {"holdout", product::holdout},
    {"object", product::object},
    {"image", product::image}};

// What is chosen for a map, and its own error, so that the bill can be judged before anything is
// rendered; with a budget, also the errors of all candidates.
struct JudgedLight {
  Lighting lighting;
  MeasuredErrors measured;
};

std::set<std::string> names_of(Products products) {
  std::set<std::string> names;
  for (const auto& [text, bit] : kProducts)
    if (products & bit) names.insert(text);
  return names;
}

Products products_of(const std::set<std::string>& names) {
  Products products = 0;
  for (const std::string& text : names) {
    const auto found = std::find_if(std::begin(kProducts), std::end(kProducts),
                                    [&](const auto& p) { return text == p.first; });
    if (found == std::end(kProducts)) {
      std::string all;
      for (const auto& [name, bit] : kProducts)
        all += (all.empty() ? "" : ", ") + std::string(name);
      throw py::value_error("no product \"" + text + "\"; there are " + all);
    }
    products |= found->second;
  }
  return products;
}

void bind_lines(py::module_& module) {
  py::class_<PlannedPass>(module, "PlannedPass", "One line of a plan.")
      .def_property_readonly(
          "name", [](const PlannedPass& p) { return std::string(name(p.pass.id)); },
          "Name of the pass, as in FrameResult.passes.")
      .def_readonly("included", &PlannedPass::included, "Whether the pass runs.")
      .def_readonly("method", &PlannedPass::method,
                    "Name of the pass's method, with its settings; empty where it has none.")
      .def_readonly("reason", &PlannedPass::reason, "Why the pass was left out; empty if it runs.")
      .def_readonly(
          "bound", &PlannedPass::bound,
          "Largest relative error that leaving it out causes; None where it is not known.")
      .def_readonly("error", &PlannedPass::error,
                    "Expected error caused by its method alone, or None where unknown: error of "
                    "the picture where errors were measured, else of the irradiance.")
      .def_readonly("milliseconds", &PlannedPass::milliseconds,
                    "Expected CPU time of one run, or None where unknown or left out.")
      .def_property_readonly(
          "reads", [](const PlannedPass& p) { return names_of(p.pass.reads); },
          "Names of the products that it is made from.")
      .def_property_readonly(
          "needs", [](const PlannedPass& p) { return names_of(p.pass.needs); },
          "Names of the products that must be fresh before it runs, but do not make it run.")
      .def_property_readonly(
          "writes", [](const PlannedPass& p) { return names_of(p.pass.writes); },
          "Names of the products that it makes.")
      .def("__repr__", [](const PlannedPass& p) {
        return "<fastibl.PlannedPass " + std::string(name(p.pass.id)) +
               (p.included ? "" : " left out: " + p.reason) + ">";
      });
  py::class_<Plan>(module, "Plan",
                   "Which passes a frame needs, and by which methods, and which it does not need, "
                   "and why. print(plan) shows the costs.")
      .def_readonly("passes", &Plan::passes, "List of PlannedPass in the order in which they run.")
      .def_readonly("methods", &Plan::methods,
                    "The method of every step, as an attribute named after the step; can be given "
                    "as methods= to make_plan and Session, and pickled.")
      .def_property_readonly(
          "expected_error", &Plan::expected_error,
          "Expected error of the picture, all methods together: RMS over RGB and over the pixels "
          "that the object covers or its shadow changes by more than 1/255, in linear light, "
          "relative to the truth's mean there. Without a budget or samples of the scene, the error "
          "of the irradiance.")
      .def_property_readonly("light_error", &Plan::light_error,
                             "Expected error of a captured map's irradiance, which is not part of "
                             "the budget: no method makes it smaller. None where the map is given.")
      .def_readonly("sampling_error", &Plan::sampling_error,
                    "What four samples a pixel leave of the picture, expected from how they differ "
                    "within pixels; not part of the budget: no method makes it smaller, but "
                    "Session(supersampling=) does. None but for a plan of one picture (camera=).")
      .def_readonly("light_unjudged", &Plan::light_unjudged,
                    "Share of the light that is new since the methods were judged, while they are "
                    "about to be judged anew; else 0. expected_error and assured_error allow for "
                    "it.")
      .def_readonly("light_in_turns", &Plan::light_in_turns,
                    "Whether each frame does only one step of the work on the light, because all "
                    "steps do not fit into the time budget: the light is then some frames old, "
                    "which light_error takes into account.")
      .def_property_readonly("assured_error", &Plan::assured_error,
                             "The value that the picture's error is not expected to exceed.")
      .def_readonly("best_error", &Plan::best_error,
                    "The smallest expected error that any choice of methods has; None where none "
                    "was measured.")
      .def_readonly("error_budget", &Plan::error_budget, "0: none was asked for.")
      .def_readonly("milliseconds_budget", &Plan::milliseconds_budget, "0: none was asked for.")
      .def_readonly("milliseconds", &Plan::milliseconds, "Expected CPU time of a frame.")
      .def_property_readonly("meets_error", &Plan::meets_error,
                             "Whether the assured error is within the budget; True without a "
                             "budget, and False until the picture was judged.")
      .def_property_readonly(
          "meets_milliseconds", &Plan::meets_milliseconds,
          "Whether the expected time is within the budget; True without a budget.")
      .def_property_readonly("meets_budget", &Plan::meets_budget, "Whether both budgets are met.")
      .def_property_readonly("omission_bound", &Plan::omission_bound,
                             "Largest relative error that leaving out passes causes, the sum over "
                             "these passes; None where one of them is not known.")
      .def("__str__", &bill)
      .def("__repr__", &bill);
}

void bind_making(py::module_& module) {
  py::class_<SceneSamples, std::shared_ptr<SceneSamples>>(module, "_SceneSamples");
  module.def(
      "_sample_scene",
      [](const Scene& scene, const Camera& camera, const Pose& camera_from_marker) {
        const WithoutGil release;
        return std::const_pointer_cast<SceneSamples>(
            sample_scene(scene, camera, camera_from_marker));
      },
      py::arg("scene"), py::arg("camera"), py::arg("camera_from_marker"),
      "Places that a picture shows; None where it shows nothing of the object.");
  py::class_<JudgedLight, std::shared_ptr<JudgedLight>>(module, "_JudgedLight");
  module.def(
      "_judge_light",
      [](const Scene& scene, const std::shared_ptr<Environment>& light, const Methods& methods,
         bool capture, bool cast_shadow, bool budgets, bool hurried, bool offline,
         const SceneSamples* samples) {
        const WithoutGil release;
        const std::shared_ptr<const CubeMap> radiance(light, &light->radiance);
        JudgedLight judged;
        LightingOptions choice;
        choice.diffuse = methods.diffuse;
        choice.diffuse_settings = methods.diffuse_settings;
        choice.glossy = methods.glossy;
        choice.glossy_settings = methods.glossy_settings;
        choice.environment = light.get();
        judged.lighting = fit_lighting(radiance, choice);
        if (budgets) {
          CandidateOptions from = candidate_options(scene, *light);
          from.light_stays = !capture, from.hurried = hurried, from.offline = offline;
          judged.measured = measure_errors(scene, samples ? samples : scene.samples.get(),
                                           {radiance, judged.lighting.near_lights}, methods,
                                           candidates(methods, from), cast_shadow);
        }
        return judged;
      },
      py::arg("scene"), py::arg("light").none(false), py::arg("methods"), py::arg("capture"),
      py::arg("cast_shadow"), py::arg("budgets"), py::arg("hurried"), py::arg("offline"),
      py::arg("samples"));
  module.def(
      "_make_plan",
      [](const Scene& scene, const Environment* environment, const JudgedLight* judged,
         const Methods& methods, bool track, bool capture, bool cast_shadow, double error,
         double milliseconds, const std::map<std::string, double>& costs, int width, int height,
         const SceneSamples* samples) {
        const WithoutGil release;
        PlanOptions options{methods, track, capture, cast_shadow, error, milliseconds, nullptr};
        options.costs = costs_from(costs);
        options.workload = workload_of(scene, width, height, capture, cast_shadow);
        if (samples) options.object = parts_of(scene, samples->object_area * width * height);
        if (judged) options.lighting = &judged->lighting, options.measured = &judged->measured;
        return make_plan(scene, environment, options);
      },
      py::arg("scene"), py::arg("environment"), py::arg("judged"), py::arg("methods"),
      py::arg("track"), py::arg("capture"), py::arg("cast_shadow"), py::arg("error"),
      py::arg("milliseconds"), py::arg("costs"), py::arg("width"), py::arg("height"),
      py::arg("samples"));
}

void bind_times(py::module_& module) {
  module.def(
      "_measure_costs",
      [] {
        const WithoutGil release;
        return costs_map(measure_costs());
      },
      "Unit costs of this machine in nanoseconds, by name; some three seconds.");
  module.def(
      "_due_seconds",
      [](const Plan& plan, int repetitions) {
        const WithoutGil release;
        std::size_t ran = 0;
        const ProcessorClock clock;
        for (int k = 0; k < repetitions; ++k) {
          Products stale = product::pose | product::back_picture;
          ran += due_passes(plan, product::image, stale).size();
        }
        check(ran > 0, "nothing was due");
        return clock.seconds() / repetitions;
      },
      py::arg("plan"), py::arg("repetitions"), "CPU seconds of due_passes for a usual frame.");
  module.def(
      "_plan_seconds",
      [](const Scene& scene, const std::shared_ptr<Environment>& environment, int repetitions) {
        const WithoutGil release;
        const Methods methods;
        const ProcessorClock measuring;
        const MeasuredErrors measured =
            measure_errors(scene, scene.samples.get(), LightToJudge::of(environment), methods,
                           candidates(methods, candidate_options(scene, *environment)), true);
        const double first = measuring.seconds();
        PlanOptions options;
        options.error = 0.02, options.measured = &measured;
        std::size_t lines = 0;
        const ProcessorClock clock;
        for (int k = 0; k < repetitions; ++k)
          lines += make_plan(scene, environment.get(), options).passes.size();
        check(lines > 0, "an empty plan");
        return std::pair(clock.seconds() / repetitions, first);
      },
      py::arg("scene"), py::arg("environment"), py::arg("repetitions"),
      "CPU seconds of make_plan with measured errors, and of measuring them for light that "
      "changes.");
  module.def(
      "_default_costs", [] { return costs_map({}); }, "The built-in cost table.");
}

void bind_errors(py::module_& module) {
  module.def(
      "_measured_errors",
      [](const Scene& scene, const std::shared_ptr<Environment>& environment,
         const Methods& methods, bool cast_shadow, bool offline, const SceneSamples* samples) {
        MeasuredErrors errors;
        {
          const WithoutGil release;
          CandidateOptions from = candidate_options(scene, *environment);
          from.light_stays = true, from.offline = offline;
          errors = measure_errors(scene, samples ? samples : scene.samples.get(),
                                  LightToJudge::of(environment), methods, candidates(methods, from),
                                  cast_shadow);
        }
        const auto means = [](const std::vector<ErrorAlone>& alone) {
          std::vector<double> result;
          for (const ErrorAlone& one : alone) result.push_back(one.mean);
          return result;
        };
        const Candidates& c = errors.candidates;
        py::list diffuse, glossy, self_shadow, shadow, bounce;
        for (const auto& d : c.diffuse) diffuse.append(described(d.method, d.settings));
        for (const auto& g : c.glossy) glossy.append(described(g.method, g.settings));
        for (const auto s : c.self_shadow) self_shadow.append(std::string(name(s)));
        for (const auto& s : c.shadow) shadow.append(described(s.method, s.settings));
        for (const auto b : c.bounce) bounce.append(std::string(name(b)));
        py::dict result;
        result["diffuse"] = py::make_tuple(diffuse, means(errors.diffuse));
        result["glossy"] = py::make_tuple(glossy, means(errors.glossy));
        result["self_shadow"] = py::make_tuple(self_shadow, means(errors.self_shadow));
        result["shadow"] = py::make_tuple(shadow, means(errors.shadow));
        result["bounce"] = py::make_tuple(bounce, means(errors.bounce));
        result["object"] = errors.object, result["object_worst"] = errors.object_worst;
        result["plane"] = errors.plane;
        return result;
      },
      py::arg("scene"), py::arg("environment"), py::arg("methods"), py::arg("cast_shadow") = true,
      py::arg("offline") = false, py::arg("samples") = py::none(),
      "Squares of the picture's errors by candidate, of each step alone, and of all of the object "
      "and the plane, for light that stays: what a plan chooses from.");
}

}  // namespace

void bind_plan(py::module_& module) {
  bind_lines(module);
  bind_making(module);
  bind_times(module);
  bind_errors(module);
  module.def(
      "due_passes",
      [](const Plan& plan, const std::set<std::string>& wanted,
         const std::set<std::string>& stale) {
        Products bits = products_of(stale);
        std::vector<std::string> due;
        for (const PassId id : due_passes(plan, products_of(wanted), bits))
          due.emplace_back(name(id));
        return py::make_tuple(due, names_of(bits));
      },
      py::arg("plan"), py::arg("wanted"), py::arg("stale"),
      "Passes that must run for the wanted products, given the stale ones, and what is still stale "
      "after they ran. Products and passes are given by name. Raises ValueError for an unknown "
      "name.");
}

}  // namespace fastibl::bindings
