#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <cmath>

#include "bindings/numpy.h"
#include "fastibl/core/parallel.h"

namespace fastibl::bindings {

void bind_core(py::module_& module) {
  module.def("set_threads", &set_threads, py::arg("count"),
             "Sets the number of threads that the library uses; 0, the initial setting, means one "
             "per core that this process may use. Results are the same to the bit for any number. "
             "Raises ValueError for a number below 0.");
  module.def("threads", &threads, "Number of threads that the library uses.");

  py::class_<Pose>(module, "Pose",
                   R"(Rigid transform, named target_from_source: x_in_target = pose @ x_in_source.

matrix: (4, 4) float64, rotation orthonormal within 1e-6, metres. Raises ValueError otherwise, TypeError for integers or
objects. Without an argument it is the identity.)")
      .def(py::init([](const py::object& matrix) {
             return matrix.is_none() ? Pose{} : require_pose(matrix, "matrix");
           }),
           py::arg("matrix") = py::none())
      .def_static(
          "from_rotation_vector",
          [](const py::object& rotation, const py::object& translation) {
            const Doubles r = require_floats<double>(rotation, "rotation"),
                          t = require_floats<double>(translation, "translation");
            if (r.size() != 3 || t.size() != 3)
              throw py::value_error("rotation and translation must have shape (3,)");
            for (int k = 0; k < 3; ++k)
              if (!std::isfinite(r.data()[k]) || !std::isfinite(t.data()[k]))
                throw py::value_error("rotation and translation must be finite");
            return Pose{rotation_from_vector({r.data()[0], r.data()[1], r.data()[2]}),
                        {t.data()[0], t.data()[1], t.data()[2]}};
          },
          py::arg("rotation"), py::arg("translation"),
          "From a rotation vector (axis times angle in radians, (3,)) and a translation in metres "
          "(3,). Raises ValueError for another shape or values that are not finite.")
      .def_static(
          "look_at",
          [](const py::object& eye, const py::object& target, const py::object& up) {
            const auto vector = [](const py::object& given, const char* name) {
              const Doubles v = require_floats<double>(given, name);
              if (v.size() != 3) throw py::value_error(std::string(name) + " must have shape (3,)");
              return glm::dvec3(v.data()[0], v.data()[1], v.data()[2]);
            };
            return Pose::look_at(vector(eye, "eye"), vector(target, "target"), vector(up, "up"));
          },
          py::arg("eye"), py::arg("target"), py::arg("up") = py::make_tuple(0.0, 0.0, 1.0),
          "camera_from_marker of a camera at `eye` that sees `target` in the middle of its "
          "picture, and `up` upwards: (3,) each, metres, marker frame. If it looks along `up`, "
          "another direction is upwards. Raises ValueError if both points are the same, or for "
          "what is not finite.")
      .def_property_readonly(
          "matrix", [](const Pose& p) { return matrix_array(p.matrix()); },
          "(4, 4) float64, a copy.")
      .def_property_readonly(
          "rotation",
          [](const Pose& p) {
            Doubles r({3, 3});
            for (int i = 0; i < 3; ++i)
              for (int j = 0; j < 3; ++j) r.mutable_at(i, j) = p.rotation[j][i];
            return r;
          },
          "(3, 3) float64, a copy.")
      .def_property_readonly(
          "translation",
          [](const Pose& p) {
            Doubles t(3);
            for (int i = 0; i < 3; ++i) t.mutable_at(i) = p.translation[i];
            return t;
          },
          "(3,) float64 metres, a copy.")
      .def("inverse", &Pose::inverse, "source_from_target.")
      .def(
          "angle_to",
          [](const Pose& a, const Pose& b) { return rotation_angle(a.rotation, b.rotation); },
          py::arg("other"), "Angle in radians between the two rotations.")
      .def(
          "__matmul__", [](const Pose& a, const Pose& b) { return a * b; }, py::arg("other"))
      .def(
          "__matmul__",
          [](const Pose& pose, const py::object& points) {
            const Doubles in = require_floats<double>(points, "points");
            if (in.ndim() < 1 || in.shape(in.ndim() - 1) != 3)
              throw py::value_error("points must have shape (..., 3), got " + shape_of(in));
            Doubles out(shape_vector(in));
            for (py::ssize_t i = 0; i < in.size(); i += 3) {
              const glm::dvec3 p =
                  pose * glm::dvec3(in.data()[i], in.data()[i + 1], in.data()[i + 2]);
              for (int c = 0; c < 3; ++c) out.mutable_data()[i + c] = p[c];
            }
            return out;
          },
          py::arg("points"),
          "Transforms points (..., 3) in the source frame to (..., 3) float64 in the target frame.")
      .def("__array__", [](const Pose& p, const py::args&,
                           const py::kwargs&) { return matrix_array(p.matrix()); })
      .def(py::self == py::self)
      .def("__repr__",
           [](const Pose& p) {
             return "Pose(" + std::string(py::repr(matrix_array(p.matrix()).attr("tolist")())) +
                    ")";
           })
      .def("__copy__", [](const Pose& p) { return p; })
      .def(
          "__deepcopy__", [](const Pose& p, const py::dict&) { return p; }, py::arg("memo"))
      .def(py::pickle(
          [](const Pose& p) { return py::make_tuple(matrix_array(p.matrix())); },
          [](const py::tuple& t) { return Pose::from_matrix(require_matrix(t[0], "matrix")); }));
}

}  // namespace fastibl::bindings
