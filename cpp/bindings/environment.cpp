#include "fastibl/scene/environment.h"

#include <pybind11/stl.h>

#include "bindings/numpy.h"
#include "fastibl/scene/main_lights.h"

namespace fastibl::bindings {
namespace {

std::array<float, 3> rgb(glm::vec3 v) { return {v.x, v.y, v.z}; }

void bind_main_lights(py::module_& module) {
  py::class_<MainLight>(module, "MainLight", "A window, a lamp or the sun, as a region of a map.")
      .def_property_readonly(
          "direction", [](const MainLight& l) { return rgb(l.direction); },
          "Towards the middle of its light, unit length, marker frame.")
      .def_readonly("solid_angle", &MainLight::solid_angle, "Steradians.")
      .def_readonly("angular_radius", &MainLight::angular_radius, "Radians, of a disc as large.")
      .def_property_readonly(
          "irradiance", [](const MainLight& l) { return rgb(l.irradiance); },
          "RGB, on a plane that faces it, by it alone.")
      .def_readonly("share", &MainLight::share,
                    "Of the irradiance of that plane, mean over RGB; 0 to 1.")
      .def_property_readonly(
          "position",
          [](const MainLight& l) -> std::optional<std::array<double, 3>> {
            if (!l.place) return std::nullopt;
            const glm::dvec3 p = l.place->position;
            return std::array<double, 3>{p.x, p.y, p.z};
          },
          "Metres, marker frame, where it was triangulated; None where it is far, or was not seen "
          "from several places.")
      .def_property_readonly(
          "covariance",
          [](const MainLight& l) -> std::optional<std::array<std::array<double, 3>, 3>> {
            if (!l.place) return std::nullopt;
            const glm::dmat3& m = l.place->covariance;
            return std::array<std::array<double, 3>, 3>{{{m[0][0], m[1][0], m[2][0]},
                                                         {m[0][1], m[1][1], m[2][1]},
                                                         {m[0][2], m[1][2], m[2][2]}}};
          },
          "(3, 3) of `position`, square metres; None without it.")
      .def("__repr__", [](const MainLight& l) {
        return "MainLight(direction=" + std::string(py::str(py::cast(rgb(l.direction)))) +
               ", angular_radius=" + std::to_string(l.angular_radius) +
               ", share=" + std::to_string(l.share) + ")";
      });
  module.def(
      "main_lights",
      [](const py::object& map, double brightness, double least_share) {
        const MainLightOptions options{brightness, least_share};
        if (py::isinstance<Environment>(map))
          return main_lights(map.cast<const Environment&>(), options);
        if (!py::isinstance<CubeMap>(map))
          throw py::type_error("expected a CubeMap or an Environment, got " +
                               std::string(py::str(py::type::of(map).attr("__name__"))));
        return main_lights(map.cast<const CubeMap&>(), options);
      },
      py::arg("map"), py::arg("brightness") = 8.0, py::arg("least_share") = 0.1,
      R"(The lights of a place as a person would count them, that with the largest irradiance first.

map: CubeMap or Environment. A light is a connected region of texels brighter than `brightness` times the map's mean
radiance that gives a plane facing it at least `least_share` of its irradiance. They stay in the map: the lights that
shading takes out of it are Lighting.lights. Raises TypeError for what is no map, ValueError for options that are not
positive and finite.)");
}

}  // namespace

void bind_environment(py::module_& module) {
  const auto faces = [](const std::vector<float>& values, int n) {
    py::array_t<float> out({6, n, n});
    std::copy(values.begin(), values.end(), out.mutable_data());
    return out;
  };
  py::class_<Environment, std::shared_ptr<Environment>>(
      module, "Environment",
      "What is known of the light of a place: radiance, and how well it is known.")
      .def(py::init(&environment_from), py::arg("radiance"), "A map that is known everywhere.")
      .def_property_readonly(
          "radiance", [](const Environment& e) -> const CubeMap& { return e.radiance; },
          py::return_value_policy::reference_internal,
          "CubeMap; unseen texels hold the mean of what was seen nearest.")
      .def_property_readonly(
          "confidence",
          [faces](const Environment& e) { return faces(e.confidence(), e.radiance.size()); },
          "(6, n, n) float32 in [0, 1]; 0 where never seen.")
      .def_property_readonly(
          "age", [faces](const Environment& e) { return faces(e.age(), e.radiance.size()); },
          "(6, n, n) float32 seconds since last seen; infinite if never.")
      .def_readonly("coverage", &Environment::coverage,
                    "Share of the sphere's solid angle that was ever seen.")
      .def_readonly("clipped", &Environment::clipped,
                    "Share of the seen solid angle whose value is only a lower bound.")
      .def_readonly("predicted_error", &Environment::predicted_error,
                    "Expected relative error of the irradiance, a median over normals.")
      .def_property_readonly(
          "predicted_interval",
          [](const Environment& e) { return py::make_tuple(e.predicted_low, e.predicted_high); },
          "(low, high): holds that error nine times in ten.")
      .def_property_readonly(
          "knowledge",
          [](const Environment& e) {
            py::dict out;
            out["unseen_sky"] = e.knowledge.unseen_sky;
            out["unseen_flux"] = e.knowledge.unseen_flux;
            out["bound_flux"] = e.knowledge.bound_flux;
            out["parallax"] = e.knowledge.parallax;
            out["prior_flux"] = e.knowledge.prior_flux;
            return out;
          },
          "What the prediction rests on, as shares: unseen_sky of the sky never seen, unseen_flux "
          "of "
          "the light in what was never seen, of which prior_flux is taken from a map from before, "
          "bound_flux of the light known as a lower bound only, parallax put wrong because things "
          "are near.")
      .def("__repr__", [](const Environment& e) {
        return "<fastibl.Environment " + std::to_string(e.radiance.size()) + "^2, coverage " +
               std::to_string(e.coverage) + ">";
      });
  bind_main_lights(module);
}

}  // namespace fastibl::bindings
