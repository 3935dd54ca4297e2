#include "fastibl/plan/plan.h"

#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstdio>
#include <set>
#include <sstream>

#include "bindings/numpy.h"
#include "fastibl/lighting/fit_lighting.h"

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

using Settings = std::map<std::string, int>;

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
    if (found == std::end(kProducts)) throw py::value_error("no product \"" + text + "\"");
    products |= found->second;
  }
  return products;
}

// Reads like a bill: pass, method, expected error, or why it is left out.
std::string bill(const Plan& plan) {
  std::ostringstream text;
  const auto percent = [](double value) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.2g %%", 100 * value);
    return std::string(buffer);
  };
  const auto column = [&](const std::string& value, std::size_t width) {
    text << value << std::string(value.size() < width ? width - value.size() : 1, ' ');
  };
  column("pass", 12), column("method", 24), text << "expected error\n";
  for (const PlannedPass& p : plan.passes) {
    column(std::string(name(p.pass.id)), 12);
    if (p.included)
      column(p.method.empty() ? "-" : p.method, 24),
          text << (p.error ? percent(*p.error) : "-") << "\n";
    else
      column("left out", 24), text << "at most " << percent(p.bound) << ": " << p.reason << "\n";
  }
  column("in all", 36), text << percent(plan.expected_error()) << " known, "
                             << percent(plan.omission_bound()) << " at most from what is left out";
  if (plan.error_budget > 0)
    text << (plan.expected_error() <= plan.error_budget ? "\nwithin" : "\nNOT within")
         << " the error budget of " << percent(plan.error_budget);
  return text.str();
}

}  // namespace

void bind_plan(py::module_& module) {
  py::class_<Methods>(module, "_Methods", "The named methods that a frame is made with.")
      .def(py::init([](const std::string& tracking, const std::string& capture,
                       const std::string& diffuse, const Settings& diffuse_settings,
                       const std::string& glossy, const Settings& glossy_settings,
                       const std::string& normalization_name, const std::string& shadow,
                       const Settings& shadow_settings, const std::string& self_shadow,
                       const std::string& bounce) {
             Methods methods;
             methods.tracking = tracking_method(tracking);
             methods.capture = capture_method(capture);
             methods.diffuse = diffuse_method(diffuse);
             methods.diffuse_settings =
                 settings_with<DiffuseSettings>(methods.diffuse, diffuse_settings);
             methods.glossy = glossy_method(glossy);
             methods.glossy_settings =
                 settings_with<GlossySettings>(methods.glossy, glossy_settings);
             methods.normalization = normalization(normalization_name);
             methods.shadow = shadow_method(shadow);
             methods.shadow_settings =
                 settings_with<ShadowSettings>(methods.shadow, shadow_settings);
             methods.self_shadow = self_shadow_method(self_shadow);
             methods.bounce = bounce_method(bounce);
             return methods;
           }),
           py::kw_only(), py::arg("tracking"), py::arg("capture"), py::arg("diffuse"),
           py::arg("diffuse_settings"), py::arg("glossy"), py::arg("glossy_settings"),
           py::arg("normalization"), py::arg("shadow"), py::arg("shadow_settings"),
           py::arg("self_shadow") = "auto", py::arg("bounce") = "auto")
      .def_static("_auto", [] { return Methods{}; })
      .def_static("_paper", &Methods::paper)
      .def_property_readonly("tracking",
                             [](const Methods& m) { return std::string(name(m.tracking)); })
      .def_property_readonly("capture",
                             [](const Methods& m) { return std::string(name(m.capture)); })
      .def_property_readonly("diffuse",
                             [](const Methods& m) { return std::string(name(m.diffuse)); })
      .def_property_readonly(
          "diffuse_settings",
          [](const Methods& m) { return settings_map(m.diffuse, m.diffuse_settings); })
      .def_property_readonly("glossy", [](const Methods& m) { return std::string(name(m.glossy)); })
      .def_property_readonly(
          "glossy_settings",
          [](const Methods& m) { return settings_map(m.glossy, m.glossy_settings); })
      .def_property_readonly("normalization",
                             [](const Methods& m) { return std::string(name(m.normalization)); })
      .def_property_readonly("shadow", [](const Methods& m) { return std::string(name(m.shadow)); })
      .def_property_readonly(
          "shadow_settings",
          [](const Methods& m) { return settings_map(m.shadow, m.shadow_settings); })
      .def_property_readonly("self_shadow",
                             [](const Methods& m) { return std::string(name(m.self_shadow)); })
      .def_property_readonly("bounce", [](const Methods& m) { return std::string(name(m.bounce)); })
      .def(py::self == py::self)
      .def("__repr__", [](const Methods& m) {
        return "Methods(tracking='" + std::string(name(m.tracking)) + "', capture='" +
               std::string(name(m.capture)) + "', diffuse='" +
               described(m.diffuse, m.diffuse_settings) + "', glossy='" +
               described(m.glossy, m.glossy_settings) + "', normalization='" +
               std::string(name(m.normalization)) + "', shadow='" +
               described(m.shadow, m.shadow_settings) + "', self_shadow='" +
               std::string(name(m.self_shadow)) + "', bounce='" + std::string(name(m.bounce)) +
               "')";
      });
  module.def(
      "_method_names",
      [](const std::string& step) {
        std::vector<std::string> names;
        const auto all = [&](const auto& methods) {
          for (const auto m : methods) names.emplace_back(name(m));
        };
        if (step == "tracking")
          all(kTrackingMethods);
        else if (step == "capture")
          all(kCaptureMethods);
        else if (step == "diffuse")
          all(kDiffuseMethods);
        else if (step == "glossy")
          all(kGlossyMethods);
        else if (step == "shadow")
          all(kShadowMethods);
        else if (step == "self_shadow")
          all(kSelfShadowMethods);
        else if (step == "bounce")
          all(kBounceMethods);
        return names;
      },
      py::arg("step"));
  module.def(
      "_method_settings",
      [](const std::string& step, const std::string& method) {
        py::dict settings;
        const auto add = [&](const auto& all) {
          for (const auto& s : all) settings[py::str(std::string(s.name))] = s.compared;
        };
        if (step == "diffuse")
          add(settings_of(diffuse_method(method)));
        else if (step == "glossy")
          add(settings_of(glossy_method(method)));
        else if (step == "shadow")
          add(settings_of(shadow_method(method)));
        return settings;
      },
      py::arg("step"), py::arg("method"),
      "Names of a method's settings, with the values that are worth comparing beside the default.");

  py::class_<PlannedPass>(module, "PlannedPass", "One line of a plan.")
      .def_property_readonly("name",
                             [](const PlannedPass& p) { return std::string(name(p.pass.id)); })
      .def_readonly("included", &PlannedPass::included)
      .def_readonly("method", &PlannedPass::method)
      .def_readonly("reason", &PlannedPass::reason,
                    "Why the pass was left out; empty if it was not.")
      .def_readonly("bound", &PlannedPass::bound,
                    "Largest relative error that leaving it out makes.")
      .def_readonly("error", &PlannedPass::error, "Expected relative error, or None where unknown.")
      .def_property_readonly("reads", [](const PlannedPass& p) { return names_of(p.pass.reads); })
      .def_property_readonly("needs", [](const PlannedPass& p) { return names_of(p.pass.needs); })
      .def_property_readonly("writes", [](const PlannedPass& p) { return names_of(p.pass.writes); })
      .def("__repr__", [](const PlannedPass& p) {
        return "<fastibl.PlannedPass " + std::string(name(p.pass.id)) +
               (p.included ? "" : " left out: " + p.reason) + ">";
      });
  py::class_<Plan>(module, "Plan",
                   "Which passes a frame needs, by which method, and which it does not, and why. "
                   "print(plan) is the bill.")
      .def_readonly("passes", &Plan::passes, "List of PlannedPass in the order in which they run.")
      .def_readonly("methods", &Plan::methods)
      .def_property_readonly(
          "expected_error", &Plan::expected_error,
          "Relative error that the included passes are expected to make, where known.")
      .def_property_readonly("omission_bound", &Plan::omission_bound,
                             "Largest relative error that leaving passes out makes.")
      .def("__str__", &bill)
      .def("__repr__", &bill);
  module.def(
      "_make_plan",
      [](const Scene& scene, const std::shared_ptr<Environment>& environment,
         const Methods& methods, bool track, bool capture, bool cast_shadow, double error,
         double milliseconds) {
        PlanOptions options{methods, track, capture, cast_shadow, error, milliseconds, nullptr};
        Lighting lighting;
        if (environment) {
          // What is chosen for this map, and its own error, so that the bill can be judged before
          // anything is rendered.
          LightingOptions choice;
          choice.diffuse = methods.diffuse;
          choice.diffuse_settings = methods.diffuse_settings;
          choice.glossy = methods.glossy;
          choice.glossy_settings = methods.glossy_settings;
          lighting = fit_lighting({environment, &environment->radiance}, choice);
          options.lighting = &lighting;
        }
        return make_plan(scene, environment.get(), options);
      },
      py::arg("scene"), py::arg("environment"), py::arg("methods"), py::arg("track"),
      py::arg("capture"), py::arg("cast_shadow"), py::arg("error"), py::arg("milliseconds"));
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
      "Passes that must run for the wanted products, given the stale ones, and what is stale after "
      "they ran. Products and passes by name.");
}

}  // namespace fastibl::bindings
