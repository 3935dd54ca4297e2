#include "fastibl/capture/capture.h"

#include <pybind11/stl.h>

#include <sstream>

#include "bindings/numpy.h"
#include "bindings/one_at_a_time.h"
#include "bindings/room_box.h"
#include "fastibl/capture/next_view.h"

namespace fastibl::bindings {

namespace {

std::string how(TakenAs as) {
  switch (as) {
    case TakenAs::told:
      return "told";
    case TakenAs::corrected:
      return "corrected";
    case TakenAs::estimated:
      return "estimated";
    case TakenAs::averaged:
      return "averaged";
    case TakenAs::assumed:
      return "assumed";
    case TakenAs::left_out:
      return "left out";
  }
  return {};
}

void bind_taken(py::module_& module) {
  py::class_<Taken>(module, "Taken", "How a picture was used for the map.")
      .def_property_readonly(
          "how", [](const Taken& t) { return how(t.as); },
          R"(Which exposure was used. "told": the one that came with the picture. "corrected": that one contradicts the
map all over the picture, and the map's was used. "estimated": none came, and the map told it. "averaged": whole
pictures of this exposure vary up and down, as short ones do under lamps on the mains: the picture was taken to be as
bright as the map, which moves towards their mean. "assumed": none came, and the map knows nothing of what the camera's
first pictures show, or those of some time: what the board's white says was used, else the last exposure, or 1.
"left out": the picture shows nothing of what it should, or no exposure came and the map cannot tell it yet.)")
      .def_readonly("exposure", &Taken::exposure, "The multiplier that was used.")
      .def_property_readonly(
          "tint",
          [](const Taken& t) {
            return std::array<double, 3>{t.tint.x, t.tint.y, t.tint.z};
          },
          "Factor on the exposure, per channel: as given, unless it was corrected.")
      .def_readonly("deviation", &Taken::deviation,
                    "Standard deviation of ln(exposure), relative to the map, where the exposure "
                    "rests on it. "
                    "The map's own scale drifts from picture to picture by as much.")
      .def_readonly("flicker", &Taken::flicker,
                    "Relative standard deviation of the light between pictures of this exposure, "
                    "where the picture was averaged; else 0.")
      .def_readonly("probes", &Taken::probes,
                    "Parts of the picture that the map was compared with.")
      .def("__repr__", [](const Taken& t) {
        std::ostringstream text;
        text << "<fastibl.Taken " << how(t.as) << ", exposure " << t.exposure << ">";
        return text.str();
      });
}

}  // namespace

void bind_capture(py::module_& module) {
  bind_taken(module);
  py::class_<Capture>(module, "Capture",
                      R"(Measures the light of a place from camera pictures with known poses.

size: face edge of the map in texels.
board: its page is masked out of the plane.
centre: where the object stands (metres, marker frame, z > 0), from which the plane is seen.
plane_albedo: albedo of the plane where no camera saw it.
paper_albedo: albedo of the board's white, which is a light meter: unseen parts of the sky are made so bright that the
map lights the plane as it is really lit.
distance: metres to what is seen above the horizon; infinite treats all light as distant. None (the default): found
from how pictures taken from several places differ (see the property), and infinite until then; once it is found, so
are the walls of a room (see the property box).
box: the room's walls, floor and ceiling instead of a distance: two corners (2, 3), metres, marker frame, around the
centre (Lagarde and Zanuttini 2012).
box_yaw: angle of the walls to the marker's axes, radians, counter-clockwise from above; the corners of `box` are given
along the walls then, from the marker's origin.
locate_lights: whether lights that several pictures show are triangulated and put where the object sees them, whatever
`distance` and `box` say.
prior: CubeMap of the place from an earlier time; its sky stands in for what no picture has seen, scaled per channel to
agree with what was seen, at confidence 0 (see Environment.knowledge).
doubt_exposures: whether a picture of a perspective camera that is brighter or darker than the map by one factor
everywhere is taken to be wrongly exposed, until this has lasted for 0.2 s.
most_boost: the largest factor per channel by which light above the horizon that clips in a camera's shortest exposure
is made brighter, until the map lights the plane as the board's white shows; 1 leaves it a lower bound. None (the
default): 10000 as soon as a camera brackets, whose shortest exposure a sun alone may still clip; 1 with cameras of one
exposure. One reading cannot tell lights apart: what faces the plane is made brighter most. Without a board, or where
its white clips, nothing is. Environment.knowledge["boosted_flux"] says how much of the light was put back.
Raises ValueError for values out of range.)")
      .def(py::init([](int size, const std::optional<Board>& board, std::array<double, 3> centre,
                       double plane_albedo, std::optional<double> distance,
                       const std::optional<RoomCorners>& box, bool locate_lights,
                       const CubeMap* prior, bool doubt_exposures, double paper_albedo,
                       std::optional<double> most_boost, double box_yaw) {
             CaptureOptions options;
             options.size = size;
             options.board = board;
             options.centre = {centre[0], centre[1], centre[2]};
             options.plane_albedo = plane_albedo;
             options.distance = distance;
             options.box = room_box(box, box_yaw);
             options.locate_lights = locate_lights;
             if (prior) options.prior = std::make_shared<const CubeMap>(*prior);
             options.doubt_exposures = doubt_exposures;
             options.paper_albedo = paper_albedo;
             options.most_boost = most_boost;
             return Capture(options);
           }),
           py::arg("size") = 128, py::arg("board") = py::none(),
           py::arg("centre") = std::array<double, 3>{0, 0, 0.05}, py::arg("plane_albedo") = 0.5,
           py::arg("distance") = py::none(), py::arg("box") = py::none(),
           py::arg("locate_lights") = true, py::arg("prior") = py::none(),
           py::arg("doubt_exposures") = false, py::arg("paper_albedo") = 0.85,
           py::arg("most_boost") = py::none(), py::arg("box_yaw") = 0.0)
      .def(
          "add",
          [](Capture& capture, const py::object& image, const Camera& camera,
             const py::object& camera_from_marker, const std::optional<double>& exposure,
             double time, const py::object& mask, const py::object& last_row,
             const std::array<double, 3>& tint, bool plane, int number) {
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
            return one_at_a_time(&capture, [&] {
              return capture.add(picture, camera, pose, exposure, time, view, last,
                                 {tint[0], tint[1], tint[2]}, plane, number);
            });
          },
          py::arg("image"), py::arg("camera"), py::arg("camera_from_marker"),
          py::arg("exposure") = 1.0, py::arg("time") = 0.0, py::arg("mask") = py::none(),
          py::arg("last_row") = py::none(), py::arg("tint") = std::array<double, 3>{1, 1, 1},
          py::arg("plane") = true, py::arg("number") = 0,
          R"(Updates the texels that a picture shows.

image: (h, w, 3) uint8 or uint16 (encoded RGB) or float (linear RGB), of the camera's size.
camera_from_marker: Pose or (4, 4).
exposure: multiplier; None where it is not known: it is then estimated from what the map knows of the places in the
picture, see Taken.
time: seconds, not decreasing.
mask: (h, w) bool or uint8, 0 where the picture shows what is not part of the place: no light is read there, nor lamps or
the board's white, nor texels for which pixels beside them are read, too.
last_row: for a rolling shutter, camera_from_marker when the picture's last row was taken; the argument
camera_from_marker is then that of the first row. In a fisheye or 360 degree picture all rows count as taken half-way
(10 degrees in a readout: 5 to 6 % of the texels' light).
tint: known factor on the exposure per channel, see fastibl.white.
plane: False where the place of the camera is a guess: what was otherwise seen of the plane is then kept.
number: tells apart cameras whose parameters are the same.
Returns Taken.
Raises ValueError or TypeError, naming what was expected and what came.)")
      .def_property_readonly(
          "distance",
          [](const Capture& capture) {
            return one_at_a_time(&capture, [&] { return capture.distance(); });
          },
          "Metres to what is seen above the horizon: as given, or as the pictures say so far; inf "
          "where all light is distant. Without meaning where a box is known.")
      .def_property_readonly(
          "box",
          [](const Capture& capture) {
            return corners(one_at_a_time(&capture, [&] { return capture.surface().box(); }));
          },
          "Corners of the room along its walls, (2, 3) float64, metres: as given, or as the "
          "pictures say so far; None where no walls are known.")
      .def_property_readonly(
          "box_yaw",
          [](const Capture& capture) {
            return yaw_of(one_at_a_time(&capture, [&] { return capture.surface().box(); }));
          },
          "Angle of these walls to the marker's axes, radians, counter-clockwise from above.")
      .def_property_readonly(
          "mended",
          [](const Capture& capture) {
            return one_at_a_time(&capture, [&] { return capture.mended(); });
          },
          R"(How often the scale of a camera that tells no exposure was found wrong.

Everything that it had shown was then made brighter or darker, so that the sky lights the board as the board's white
says.)")
      .def(
          "next_exposure",
          [](const Capture& capture, const Camera& camera, const py::object& camera_from_marker,
             double shortest, double longest) {
            const Pose pose = require_pose(camera_from_marker, "camera_from_marker");
            return one_at_a_time(&capture, [&] {
              return capture.next_exposure(camera, pose, {shortest, longest});
            });
          },
          py::arg("camera"), py::arg("camera_from_marker"), py::arg("shortest"), py::arg("longest"),
          R"(The exposure with which a camera at this pose tells most of what the map lacks.

It is shorter where texels were never seen without clipping, longer where they are dark and noisy; candidates go from
`longest` down to `shortest` in stops. camera: a perspective one. camera_from_marker: where it is about to look. Raises
ValueError for another camera or an invalid range.)")
      .def(
          "turn",
          [](Capture& capture, const py::object& new_from_old) {
            const Pose pose = require_pose(new_from_old, "new_from_old");
            one_at_a_time(&capture, [&] { capture.turn(pose.rotation); });
          },
          py::arg("new_from_old"),
          R"(Tells the capture that the marker was turned.

What is above the horizon turns, and so does a prior; lights have to be located anew, and the plane is forgotten. What the
board's white showed of the light stays, unless the plane is tilted by more than 5 degrees.
new_from_old: Pose or (4, 4), of which the rotation counts. Raises ValueError for what is none.)")
      .def(
          "environment",
          [](Capture& capture) {
            return one_at_a_time(&capture, [&] {
              return std::const_pointer_cast<Environment>(capture.environment());
            });
          },
          "Environment at the time of the last picture, without holes.")
      .def_property_readonly(
          "last_seen",
          [](const Capture& capture) {
            const int n = capture.size();
            py::array_t<double> out({6, n, n});
            const std::vector<double> times =
                one_at_a_time(&capture, [&] { return capture.last_seen(); });
            std::copy(times.begin(), times.end(), out.mutable_data());
            return out;
          },
          "Time at which each texel was last seen: (6, n, n) float64; -inf if never.")
      .def("__repr__",
           [](const Capture& c) { return "<fastibl.Capture " + std::to_string(c.size()) + "^2>"; });
  module.def(
      "_next_view",
      [](const Environment& environment, const py::object& looking) {
        std::optional<glm::dvec3> at;
        if (!looking.is_none()) at = glm::dvec3(require_triple(looking, "looking"));
        NextView next;
        {
          const WithoutGil release;
          next = next_view(environment, at);
        }
        py::object direction = py::none();
        if (next.direction) direction = py::array_t<double>(3, &next.direction->x);
        return py::make_tuple(direction, next.share);
      },
      py::arg("environment"), py::arg("looking"),
      "Direction (3,) in whose surroundings most light is unseen, or None, and its share.");
}

}  // namespace fastibl::bindings
