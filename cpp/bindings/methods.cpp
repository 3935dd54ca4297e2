#include "fastibl/scene/methods.h"

#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <map>
#include <string>
#include <vector>

#include "bindings/module.h"
#include "bindings/numpy.h"

namespace fastibl::bindings {
namespace {

using Settings = std::map<std::string, int>;

void bind_choice(py::module_& module) {
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
      .def("__reduce__",
           [](const py::object& self) {
             py::dict all;
             for (const char* name : {"tracking", "capture", "diffuse", "glossy", "normalization",
                                      "shadow", "self_shadow", "bounce"})
               all[name] = self.attr(name);
             const Methods& m = self.cast<const Methods&>();
             all["diffuse_settings"] = given_settings(m.diffuse, m.diffuse_settings);
             all["glossy_settings"] = given_settings(m.glossy, m.glossy_settings);
             all["shadow_settings"] = given_settings(m.shadow, m.shadow_settings);
             const py::object make = py::module_::import("functools").attr("partial");
             return py::make_tuple(make(py::type::of(self), **all), py::tuple());
           })
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
}

}  // namespace

void bind_methods(py::module_& module) {
  bind_choice(module);
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
}

}  // namespace fastibl::bindings
