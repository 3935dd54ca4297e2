#include "fastibl/capture/capture.h"

#include <pybind11/stl.h>

#include "bindings/numpy.h"
#include "bindings/room_box.h"

namespace fastibl::bindings {

void bind_capture(py::module_& module) {
  py::class_<Capture>(module, "Capture",
                      R"(Measures the light of a place from camera pictures with known poses.

size: face edge of the map in texels. board: its page is masked out of the plane. centre: where the object stands
(metres, marker frame, z > 0), from which the plane is seen. plane_albedo: of the plane where no camera saw it.
distance: metres to what is seen above the horizon; infinite (the default) takes all light as distant. box: instead of
it the room's walls, floor and ceiling: two corners (2, 3), metres, marker frame, around the centre (Lagarde and
Zanuttini 2012). locate_lights: whether lights that several pictures show are triangulated and put where the object
sees them, whatever `distance` and `box` say.
Raises ValueError for values out of range.)")
      .def(py::init([](int size, const std::optional<Board>& board, std::array<double, 3> centre,
                       double plane_albedo, double distance,
                       const std::optional<std::array<std::array<double, 3>, 2>>& box,
                       bool locate_lights) {
             CaptureOptions options;
             options.size = size;
             options.board = board;
             options.centre = {centre[0], centre[1], centre[2]};
             options.plane_albedo = plane_albedo;
             options.distance = distance;
             options.box = room_box(box);
             options.locate_lights = locate_lights;
             return Capture(options);
           }),
           py::arg("size") = 128, py::arg("board") = py::none(),
           py::arg("centre") = std::array<double, 3>{0, 0, 0.05}, py::arg("plane_albedo") = 0.5,
           py::arg("distance") = std::numeric_limits<double>::infinity(),
           py::arg("box") = py::none(), py::arg("locate_lights") = true)
      .def(
          "add",
          [](Capture& capture, const py::object& image, const Camera& camera,
             const py::object& camera_from_marker, double exposure, double time,
             const py::object& mask, const py::object& last_row, bool plane) {
            py::array keep, keep_mask;
            const Picture picture = require_picture(image, "image", keep);
            const Pose pose = require_pose(camera_from_marker, "camera_from_marker");
            std::optional<Pose> last;
            if (!last_row.is_none()) last = require_pose(last_row, "last_row");
            ImageView<const std::uint8_t> view;
            if (!mask.is_none()) {
              const py::array given = py::array::ensure(mask);
              if (!given || given.ndim() != 2 ||
                  (given.dtype().kind() != 'b' &&
                   !(given.dtype().kind() == 'u' && given.dtype().itemsize() == 1))) {
                PyErr_Clear();
                throw py::type_error("mask must be a (height, width) array of bool or uint8");
              }
              keep_mask = py::array::ensure(given, py::array::c_style);
              view = {static_cast<const std::uint8_t*>(keep_mask.data()), int(keep_mask.shape(1)),
                      int(keep_mask.shape(0)), 1, keep_mask.shape(1)};
            }
            const py::gil_scoped_release release;
            capture.add(picture, camera, pose, exposure, time, view, last, plane);
          },
          py::arg("image"), py::arg("camera"), py::arg("camera_from_marker"),
          py::arg("exposure") = 1.0, py::arg("time") = 0.0, py::arg("mask") = py::none(),
          py::arg("last_row") = py::none(), py::arg("plane") = true,
          R"(Update the texels that a picture sees.

image: (h, w, 3) uint8 or uint16 (encoded RGB) or float (linear RGB), of the camera's size. camera_from_marker: Pose
or (4, 4). exposure: multiplier. time: seconds, not decreasing. mask: (h, w) bool or uint8, 0 where the picture shows
what is not part of the place. last_row: where a rolling shutter reads the picture, camera_from_marker when its last
row was taken; camera_from_marker is then that of the first row. plane: False where the place of the camera is a guess:
what was seen of the plane otherwise stays. Raises ValueError or TypeError, naming what was
expected and what came.)")
      .def(
          "turn",
          [](Capture& capture, const Pose& new_from_old) {
            const py::gil_scoped_release release;
            capture.turn(new_from_old.rotation);
          },
          py::arg("new_from_old"),
          "The marker was turned: what is above the horizon turns with the rotation of this Pose, "
          "and lights are to be located anew; the plane is forgotten.")
      .def(
          "environment",
          [](Capture& capture) {
            const py::gil_scoped_release release;
            return std::const_pointer_cast<Environment>(capture.environment());
          },
          "Environment at the time of the last picture, without holes.")
      .def_property_readonly(
          "last_seen",
          [](const Capture& capture) {
            const int n = capture.size();
            py::array_t<double> out({6, n, n});
            const std::vector<double> times = capture.last_seen();
            std::copy(times.begin(), times.end(), out.mutable_data());
            return out;
          },
          "(6, n, n) float64: time at which each texel was last seen; -inf if never.")
      .def("__repr__",
           [](const Capture& c) { return "<fastibl.Capture " + std::to_string(c.size()) + "^2>"; });
}

}  // namespace fastibl::bindings
