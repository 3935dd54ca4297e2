#include "fastibl/scene/environment.h"

#include <pybind11/stl.h>

#include "bindings/environment_state.h"
#include "bindings/numpy.h"
#include "bindings/room_box.h"
#include "fastibl/scene/main_lights.h"

namespace fastibl::bindings {
namespace {

// lights: (m, 4), known exactly.
Environment known_environment(const CubeMap& radiance, const py::object& centre,
                              const py::object& lights, const std::optional<RoomCorners>& box,
                              double box_yaw) {
  Environment environment = environment_from(radiance);
  if (!centre.is_none()) {
    const Doubles at = require_floats<double>(centre, "centre");
    if (at.ndim() != 1 || at.shape(0) != 3)
      throw py::value_error("centre must have shape (3,), got " + shape_of(at));
    environment.centre = {at.at(0), at.at(1), at.at(2)};
    for (int k = 0; k < 3; ++k)
      if (!std::isfinite(environment.centre[k]))
        throw py::value_error("centre must be finite, got " + std::string(py::str(at)));
  }
  environment.box = room_box(box, box_yaw);
  if (environment.box) check_box(*environment.box, environment.centre);
  if (lights.is_none()) return environment;
  const Doubles array = require_floats<double>(lights, "lights");
  if (array.ndim() != 2 || array.shape(1) != 4)
    throw py::value_error("lights must have shape (m, 4), got " + shape_of(array));
  for (py::ssize_t i = 0; i < array.shape(0); ++i) {
    LightPosition light;
    light.position = {array.at(i, 0), array.at(i, 1), array.at(i, 2)};
    light.radius = array.at(i, 3);
    const glm::dvec3 arrow = light.position - environment.centre;
    if (glm::length(arrow) > 0) light.direction = glm::normalize(arrow);
    environment.light_positions.push_back(light);
  }
  return environment;
}

void bind_main_lights(py::module_& module) {
  py::class_<MainLight>(module, "MainLight", "A window, a lamp or the sun, as a region of a map.")
      .def_property_readonly(
          "direction", [](const MainLight& l) { return triple(l.direction); },
          "Direction towards the middle of its light, unit length, marker frame.")
      .def_readonly("solid_angle", &MainLight::solid_angle, "Steradians.")
      .def_readonly("angular_radius", &MainLight::angular_radius,
                    "Angular radius of a disc of the same size, radians.")
      .def_property_readonly(
          "irradiance", [](const MainLight& l) { return triple(l.irradiance); },
          "Irradiance on a plane that faces the light, from this light alone, RGB.")
      .def_readonly("share", &MainLight::share,
                    "Its share of the irradiance of that plane, mean over RGB; 0 to 1.")
      .def_property_readonly(
          "position",
          [](const MainLight& l) -> std::optional<std::array<double, 3>> {
            if (!l.place) return std::nullopt;
            const glm::dvec3 p = l.place->position;
            return std::array<double, 3>{p.x, p.y, p.z};
          },
          "Triangulated position in metres, marker frame; None where the light is far, or was not "
          "seen from several places.")
      .def_property_readonly(
          "covariance",
          [](const MainLight& l) -> std::optional<std::array<std::array<double, 3>, 3>> {
            if (!l.place) return std::nullopt;
            const glm::dmat3& m = l.place->covariance;
            return std::array<std::array<double, 3>, 3>{{{m[0][0], m[1][0], m[2][0]},
                                                         {m[0][1], m[1][1], m[2][1]},
                                                         {m[0][2], m[1][2], m[2][2]}}};
          },
          "Covariance (3, 3) of `position`, square metres; None if there is no position.")
      .def(py::pickle(&main_light_state, &main_light_from_state))
      .def("__repr__", [](const MainLight& l) {
        return "MainLight(direction=" + std::string(py::str(triple(l.direction))) +
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
          throw py::type_error("map must be CubeMap or Environment, got " + type_name(map));
        return main_lights(map.cast<const CubeMap&>(), options);
      },
      py::arg("map"), py::arg("brightness") = 8.0, py::arg("least_share") = 0.1,
      R"(The lights of a place as a person would count them, the one with the largest irradiance first.

map: CubeMap or Environment. A light is a connected region of texels brighter than `brightness` times the map's mean
radiance that gives a plane facing it at least `least_share` of its irradiance. These lights stay in the map; those that
shading takes out of it are Lighting.lights. Raises TypeError for what is not a map, ValueError for options that are not
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
      .def(py::init(&known_environment), py::arg("radiance"), py::kw_only(),
           py::arg("centre") = py::none(), py::arg("lights") = py::none(),
           py::arg("box") = py::none(), py::arg("box_yaw") = 0.0,
           R"(A map that is known everywhere.

centre: (3,) metres, marker frame: the place from which the map is seen, (0, 0, 0) by default.
lights: (m, 4) x y z radius, metres: those lights of the map that are near, as spheres; their light then changes from
place to place. Spheres that are not finite, or that contain the centre, are taken as distant.
box: walls, floor and ceiling of the room that the map shows, two corners (2, 3), metres; glossy surfaces then reflect
them where they are.
box_yaw: angle of the walls to the marker's axes, radians, counter-clockwise from above; the corners are given along the
walls then, from the marker's origin.
Raises ValueError for other shapes, a centre that is not finite, or a box that does not contain the centre.)")
      .def_property_readonly(
          "centre", [](const Environment& e) { return triple(e.centre); },
          "The place from which the radiance is seen, metres, marker frame.")
      .def_property_readonly(
          "box", [](const Environment& e) { return corners(e.box); },
          "Corners of the room along its walls, (2, 3) float64, metres; None where nobody told "
          "them.")
      .def_property_readonly(
          "box_yaw", [](const Environment& e) { return yaw_of(e.box); },
          "Angle of the walls to the marker's axes, radians, counter-clockwise from above. It "
          "changes where capture finds that the marker was turned.")
      .def_property_readonly(
          "light_positions",
          [](const Environment& e) {
            Doubles out({py::ssize_t(e.light_positions.size()), py::ssize_t{4}});
            for (std::size_t i = 0; i < e.light_positions.size(); ++i) {
              const LightPosition& light = e.light_positions[i];
              for (int k = 0; k < 3; ++k) out.mutable_at(py::ssize_t(i), k) = light.position[k];
              out.mutable_at(py::ssize_t(i), 3) = light.radius;
            }
            return out;
          },
          "(m, 4) float64: x y z and radius, metres, of the lights that are known to be near.")
      .def_property_readonly(
          "radiance", [](const Environment& e) -> const CubeMap& { return e.radiance; },
          py::return_value_policy::reference_internal,
          "CubeMap; unseen texels hold the mean of what was seen nearest.")
      .def_property_readonly(
          "confidence",
          [faces](const Environment& e) { return faces(e.confidence(), e.radiance.size()); },
          "(6, n, n) float32 in [0, 1]; 0 where a texel was never seen. 1 / (1 + (d / 0.1)^2) "
          "where its "
          "radiance is expected to be off by a share d (standard deviation), by noise and by age.")
      .def_property_readonly(
          "age", [faces](const Environment& e) { return faces(e.age(), e.radiance.size()); },
          "Seconds since each texel was last seen, (6, n, n) float32; infinite if never.")
      .def_readonly("coverage", &Environment::coverage,
                    "Share of the sphere's solid angle that was ever seen.")
      .def_readonly("clipped", &Environment::clipped,
                    "Share of the seen solid angle whose value is only a lower bound.")
      .def_readonly("predicted_error", &Environment::predicted_error,
                    "Expected relative error of the irradiance, a median over normals.")
      .def_property_readonly(
          "predicted_interval",
          [](const Environment& e) { return py::make_tuple(e.predicted_low, e.predicted_high); },
          "(low, high): an interval that holds that error nine times in ten, with a board in view "
          "or without one, of films and of single pictures whose exposures are told.")
      .def_property_readonly(
          "plane_irradiance",
          [](const Environment& e) -> py::object {
            if (!e.plane_irradiance) return py::none();
            return triple(*e.plane_irradiance);
          },
          "Irradiance (r, g, b) on the plane, as the board's white shows it; None where the white "
          "was not seen.")
      .def_property_readonly(
          "knowledge",
          [](const Environment& e) {
            py::dict out;
            out["unseen_sky"] = e.knowledge.unseen_sky;
            out["unseen_flux"] = e.knowledge.unseen_flux;
            out["guessed_plane"] = e.knowledge.guessed_plane;
            out["bound_flux"] = e.knowledge.bound_flux;
            out["weighed_flux"] = e.knowledge.weighed_flux;
            out["weighed_spread"] = e.knowledge.weighed_spread;
            out["bound_doubt"] = e.knowledge.bound_doubt;
            out["parallax"] = e.knowledge.parallax;
            out["parallax_doubt"] = e.knowledge.parallax_doubt;
            out["prior_flux"] = e.knowledge.prior_flux;
            out["boosted_flux"] = e.knowledge.boosted_flux;
            out["scale"] = e.knowledge.scale;
            return out;
          },
          "What the prediction rests on, as shares. Of the sky, unseen_sky was never seen. Of the "
          "light, unseen_flux is in what was never seen; prior_flux is the part of that taken from "
          "an earlier map, and guessed_plane that in a plane of which little was seen. Of the "
          "light above the horizon, bound_flux is known as a lower bound only; weighed_flux of it "
          "clips in the shortest exposure, too, and was compared with the board's white, "
          "boosted_flux was put back (see Capture's most_boost), and bound_doubt may still be "
          "missing, one standard deviation. weighed_spread is 0 where one light clips, 1 where they "
          "surround the object. Of the "
          "irradiance, parallax is put in the wrong place because things are near, as far as their "
          "lights tell; parallax_doubt may be put wrong as well, since little was seen of how near "
          "things are. scale is the share by which all of it may "
          "be wrong where a camera never told an exposure, as the board's white says.")
      .def(py::pickle(&environment_state, &environment_from_state))
      .def("__repr__", [](const Environment& e) {
        return "<fastibl.Environment " + std::to_string(e.radiance.size()) + "^2, coverage " +
               std::to_string(e.coverage) + ">";
      });
  bind_main_lights(module);
}

}  // namespace fastibl::bindings
