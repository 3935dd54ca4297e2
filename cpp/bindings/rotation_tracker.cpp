#include "fastibl/tracking/rotation_tracker.h"

#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include "bindings/numpy.h"

namespace fastibl::bindings {
namespace {

py::tuple turned_state(const Turned& t) {
  return py::make_tuple(t.back_from_marker, t.covariance, t.drift, t.position_deviation, t.residual,
                        t.agreeing, t.features, t.back_gain, t.front_gain, t.since, t.velocity.x,
                        t.velocity.y, t.velocity.z);
}

Turned turned_from(const py::tuple& t) {
  const auto number = [&](int k) { return t[std::size_t(k)].cast<double>(); };
  return {t[0].cast<Pose>(),
          t[1].cast<std::array<double, 9>>(),
          number(2),
          number(3),
          number(4),
          number(5),
          t[6].cast<int>(),
          number(7),
          number(8),
          number(9),
          {number(10), number(11), number(12)}};
}

RigPictures rig_pictures(const py::object& back, const py::object& front, double back_exposure,
                         double front_exposure, py::array& keep_back, py::array& keep_front) {
  RigPictures pictures;
  if (!back.is_none()) pictures.back = require_picture(back, "back", keep_back);
  if (!front.is_none()) pictures.front = require_picture(front, "front", keep_front);
  pictures.back_exposure = back_exposure, pictures.front_exposure = front_exposure;
  return pictures;
}

void bind_turned(py::module_& module) {
  py::class_<Turned>(module, "Turned",
                     R"(A pose that rests on the captured map: the board is out of view.

The rotation is measured; the camera's place is the one from which the board was last seen, or, where the surroundings
are near, as they show it. Where nothing of the map can be seen, the rotation is a gyroscope's alone: features, residual
and agreeing are 0.)")
      .def_readonly("back_from_marker", &Turned::back_from_marker, "Pose.")
      .def_property_readonly(
          "covariance",
          [](const Turned& t) {
            Doubles out({3, 3});
            std::copy(t.covariance.begin(), t.covariance.end(), out.mutable_data());
            return out;
          },
          "Covariance (3, 3) float64 of w, where the true rotation is exp([w]x) R: rad^2, back "
          "camera's frame. It is relative to the marker and includes the drift of the map.")
      .def_readonly("drift", &Turned::drift,
                    "Standard deviation of the map's own rotation there, radians.")
      .def_readonly("position_deviation", &Turned::position_deviation,
                    "Standard deviation of the camera's place; metres.")
      .def_readonly("residual", &Turned::residual,
                    "Difference of the pictures from the map, divided by the expected difference.")
      .def_readonly("agreeing", &Turned::agreeing, "Share of the compared texels that agrees.")
      .def_readonly("features", &Turned::features, "Texels of the map that were compared.")
      .def_readonly("back_gain", &Turned::back_gain,
                    "Factor by which the back picture is brighter than the map says; 1 without a "
                    "back picture.")
      .def_readonly("front_gain", &Turned::front_gain, "The same factor for the front picture.")
      .def_readonly("since", &Turned::since, "Seconds since the pose was last known.")
      .def_property_readonly(
          "velocity",
          [](const Turned& t) {
            Doubles out(3);
            for (int k = 0; k < 3; ++k) out.mutable_data()[k] = t.velocity[k];
            return out;
          },
          "(3,) float64, rad/s, marker frame: t seconds later, the rotation is R exp([t "
          "velocity]x).")
      .def(py::self == py::self)
      .def("__repr__",
           [](const Turned& t) {
             return "<fastibl.Turned by " + std::to_string(t.features) + " texels, residual " +
                    std::string(py::str(py::float_(t.residual))) + ">";
           })
      .def(py::pickle(&turned_state, &turned_from));
}

}  // namespace

void bind_rotation_tracker(py::module_& module) {
  bind_turned(module);
  py::class_<RotationTracker>(module, "_RotationTracker")
      .def(py::init([](const Rig& rig, const py::dict& given) {
             RotationTrackingOptions o;
             const auto read = [&](const char* name, auto& value) {
               if (given.contains(name))
                 value = given[name].cast<std::remove_reference_t<decltype(value)>>();
             };
             read("acceleration", o.acceleration), read("largest_error", o.largest_error);
             read("largest_residual", o.largest_residual);
             read("least_agreeing", o.least_agreeing), read("longest_gap", o.longest_gap);
             read("wander", o.wander), read("sure", o.sure);
             read("coarsest", o.alignment.coarsest), read("rounds", o.alignment.rounds);
             read("most", o.alignment.most), read("model_noise", o.alignment.model_noise);
             read("gain_deviation", o.alignment.gain_deviation);
             read("misfit", o.alignment.misfit), read("coarse_misfit", o.alignment.coarse_misfit),
                 read("gyro_noise", o.gyro_noise), read("gyro_scale", o.gyro_scale);
             read("independent", o.alignment.independent);
             return std::make_unique<RotationTracker>(rig, o);
           }),
           py::arg("rig"), py::arg("options") = py::dict())
      .def(
          "start",
          [](RotationTracker& t, const py::object& pose, double time, const py::object& back,
             const py::object& front, double back_exposure, double front_exposure) {
            py::array keep_back, keep_front;
            const RigPictures pictures =
                rig_pictures(back, front, back_exposure, front_exposure, keep_back, keep_front);
            const Pose known = require_pose(pose, "back_from_marker");
            const WithoutGil release;
            t.start(known, time, pictures);
          },
          py::arg("back_from_marker"), py::arg("time"), py::arg("back"), py::arg("front"),
          py::arg("back_exposure"), py::arg("front_exposure"))
      .def(
          "track",
          [](RotationTracker& tracker, const Environment& environment, const py::object& back,
             const py::object& front, double back_exposure, double front_exposure, double time,
             const std::optional<std::array<double, 3>>& turn) {
            py::array keep_back, keep_front;
            const RigPictures pictures =
                rig_pictures(back, front, back_exposure, front_exposure, keep_back, keep_front);
            std::optional<glm::dmat3> rotation;
            if (turn) rotation = rotation_from_vector({(*turn)[0], (*turn)[1], (*turn)[2]});
            const WithoutGil release;
            return tracker.track(environment, pictures, time, rotation);
          },
          py::arg("environment"), py::arg("back"), py::arg("front"), py::arg("back_exposure"),
          py::arg("front_exposure"), py::arg("time"), py::arg("turn"))
      .def("reset", &RotationTracker::reset)
      .def_property_readonly("following", &RotationTracker::following,
                             "Whether a rotation is known to go on from.");
}

}  // namespace fastibl::bindings
