#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include "bindings/detector.h"
#include "bindings/numpy.h"
#include "fastibl/scene/tag_codes.h"
#include "fastibl/tracking/edge_points.h"
#include "fastibl/tracking/edge_tracker.h"
#include "fastibl/tracking/fit_edges.h"
#include "fastibl/tracking/tracker.h"

namespace fastibl::bindings {
namespace {

ImageView<const std::uint8_t> require_grey(const py::array_t<std::uint8_t>& grey) {
  if (grey.ndim() != 2)
    throw py::value_error("grey must have shape (height, width), got " + shape_of(grey));
  if (grey.shape(0) < 1 || grey.shape(1) < 1 || grey.strides(1) != 1)
    throw py::value_error("grey must have rows of packed pixels, got shape " + shape_of(grey));
  return {grey.data(), int(grey.shape(1)), int(grey.shape(0)), 1, grey.strides(0)};
}

Doubles covariance_array(const std::array<double, 36>& covariance) {
  Doubles out({6, 6});
  std::copy(covariance.begin(), covariance.end(), out.mutable_data());
  return out;
}

py::tuple tracked_state(const Tracked& t) {
  return py::make_tuple(t.camera_from_marker, t.residual_px, t.tags, t.covariance, t.ambiguous,
                        t.ambiguity, t.edges, t.pixels, t.last_row, t.misfit_px);
}

std::optional<glm::dvec3> optional_vector(const py::object& object, const char* name) {
  if (object.is_none()) return std::nullopt;
  const Doubles v = require_floats<double>(object, name);
  if (v.ndim() != 1 || v.shape(0) != 3)
    throw py::value_error(std::string(name) + " must have shape (3,), got " + shape_of(v));
  return glm::dvec3(v.at(0), v.at(1), v.at(2));
}

void bind_edge_tracker(py::module_& module) {
  py::class_<EdgeTracker>(module, "_EdgeTracker", "Follows a board from frame to frame.")
      .def(py::init([](const Board& board, const Camera& camera, double smoothing,
                       const py::object& gravity_in_marker) {
             EdgeTrackingOptions options;
             options.smoothing = smoothing;
             options.gravity_in_marker =
                 optional_vector(gravity_in_marker, "gravity_in_marker").value_or(glm::dvec3(0));
             return std::make_unique<EdgeTracker>(board, camera, options);
           }),
           py::arg("board"), py::arg("camera"), py::kw_only(), py::arg("smoothing") = 0.0,
           py::arg("gravity_in_marker") = py::none())
      .def(
          "track",
          [](EdgeTracker& tracker, const py::object& image, std::optional<double> time,
             const py::object& detector, const py::object& turn, const py::object& gravity) {
            py::array keep;
            const Picture picture = require_picture(image, "image", keep);
            const Detector wrapped = make_detector(detector);
            MotionHint hint;
            if (const auto w = optional_vector(turn, "turn")) hint.turn = rotation_from_vector(*w);
            hint.gravity = optional_vector(gravity, "gravity");
            const WithoutGil release;
            return tracker.track(picture, time, wrapped, hint);
          },
          py::arg("image"), py::arg("time"), py::arg("detector"), py::arg("turn") = py::none(),
          py::arg("gravity") = py::none(),
          "One frame. turn: rotation vector (3,) of the camera since the last frame; gravity: (3,) "
          "downwards; both in the camera frame.")
      .def("reset", &EdgeTracker::reset, "Forgets the last pose: the next frame is detected.")
      .def_property_readonly("following", &EdgeTracker::following,
                             "Whether the next frame is searched near the last pose.");
}

}  // namespace

void bind_tracking(py::module_& module) {
  py::class_<DetectedTag>(module, "DetectedTag",
                          "A tag found in a picture: id, and corners (4, 2) in pixels whose "
                          "centres are at + 0.5, in the order of Tag.corners.")
      .def(py::init([](int id, const py::object& corners) {
             return DetectedTag{id, require_corners(corners, "corners")};
           }),
           py::arg("id"), py::arg("corners"))
      .def_readonly("id", &DetectedTag::id, "Number in family 36h11.")
      .def_property_readonly(
          "corners", [](const DetectedTag& t) { return corners_array(t.corners); },
          "(4, 2) float64 pixels, pixel centres at + 0.5.")
      .def(py::self == py::self)
      .def(
          "__repr__",
          [](const DetectedTag& t) { return "<fastibl.DetectedTag " + std::to_string(t.id) + ">"; })
      .def(py::pickle(
          [](const DetectedTag& t) { return py::make_tuple(t.id, corners_array(t.corners)); },
          [](const py::tuple& t) {
            return DetectedTag{t[0].cast<int>(), require_corners(t[1], "corners")};
          }));

  py::class_<Tracked>(module, "Tracked", "Where a camera sees the board in one picture.")
      .def_readonly("camera_from_marker", &Tracked::camera_from_marker,
                    "Pose at the picture's time; for a rolling shutter, the pose of the first row, "
                    "and the time is the middle of that row's exposure.")
      .def_readonly("last_row", &Tracked::last_row,
                    "Pose when the last row was taken, `camera.readout` later, for Capture.add; "
                    "None for a global shutter.")
      .def_readonly("residual_px", &Tracked::residual_px,
                    "RMS distance in pixels between the seen and expected corners of `tags`; with "
                    "`edges`, the median distance between seen and expected edges.")
      .def_readonly(
          "misfit_px", &Tracked::misfit_px,
          "With `edges`, standard deviation in x and y of the places of the board's parts about "
          "the fitted places, beyond their scatter: 0 where the print is flat and matches the "
          "board, and the lens is as calibrated. The covariance includes its effect on the pose.")
      .def_readonly(
          "edges", &Tracked::edges,
          "Number of stretches of edge on which the pose rests; 0 where it rests on corners.")
      .def_readonly("pixels", &Tracked::pixels,
                    "Number of pixels along edges whose light refined that pose; 0 where they "
                    "contradict the edges or tell nothing.")
      .def_readonly("tags", &Tracked::tags, "List of the DetectedTags that were used.")
      .def_property_readonly(
          "covariance", [](const Tracked& t) { return covariance_array(t.covariance); },
          R"((6, 6) float64 of (w, d), where the true pose is {exp([w]x) R, t + d}: rotation first, in rad^2, rad m and
m^2, camera frame. It describes only the minimum that was chosen: see `ambiguous`.)")
      .def_readonly("ambiguous", &Tracked::ambiguous,
                    "True where the pose with the board's normal mirrored about the viewing "
                    "direction fits nearly as well.")
      .def_readonly("ambiguity", &Tracked::ambiguity,
                    "Cost of this pose divided by the cost of the mirrored one, 0 to 1; 0 where "
                    "there is no second minimum.")
      .def(py::self == py::self)
      .def("__repr__",
           [](const Tracked& t) {
             return "<fastibl.Tracked by " + std::to_string(t.tags.size()) + " tags, residual " +
                    std::string(py::str(py::float_(t.residual_px))) + " px" +
                    (t.ambiguous ? ", ambiguous>" : ">");
           })
      .def(py::pickle(&tracked_state, [](const py::tuple& t) {
        return Tracked{
            t[0].cast<Pose>(),   t[8].cast<std::optional<Pose>>(),      t[1].cast<double>(),
            t[9].cast<double>(), t[2].cast<std::vector<DetectedTag>>(), t[6].cast<int>(),
            t[7].cast<int>(),    t[3].cast<std::array<double, 36>>(),   t[4].cast<bool>(),
            t[5].cast<double>()};
      }));

  bind_edge_tracker(module);
  module.def(
      "_track_edges",
      [](const py::object& image, const Board& board, const Camera& camera, const Pose& start) {
        py::array keep;
        const Picture picture = require_picture(image, "image", keep);
        if (picture.type != PixelType::uint8) throw py::type_error("image must be uint8");
        const EdgeModel model(board, camera);
        const WithoutGil release;
        return model.track({picture.row(0), picture.width, picture.height, 3, picture.stride()},
                           start, {}, {});
      },
      py::arg("image"), py::arg("board"), py::arg("camera"), py::arg("start"),
      "The pose near `start` that the edges agree with, or None.");
  module.def(
      "_tag_black", [](int id, int row, int column) { return tag_module_black(id, row, column); },
      py::arg("id"), py::arg("row"), py::arg("column"), "Whether a data module of 36h11 is black.");
  module.def(
      "_edge_points",
      [](const py::array_t<std::uint8_t>& grey, const Board& board, const Camera& camera,
         const Pose& pose, bool far, double spread) {
        const BoardPattern pattern = pattern_of(board);
        const LightTable table(camera.response, 1);
        const LightReader light(require_grey(grey), table);
        const auto tags = project_tags(pattern, camera, Lens(camera), pose);
        const FoundEdges found = find_edges(light, pattern, tags, {far, 0, spread});
        Doubles out({py::ssize_t(found.points.size()), py::ssize_t{9}});
        for (std::size_t i = 0; i < found.points.size(); ++i) {
          const EdgePoint& p = found.points[i];
          const double row[9] = {p.point.x,  p.point.y, p.pixel.x, p.pixel.y,  p.normal.x,
                                 p.normal.y, p.offset,  p.noise,   p.steepness};
          std::copy(row, row + 9, out.mutable_data(py::ssize_t(i)));
        }
        return out;
      },
      py::arg("grey"), py::arg("board"), py::arg("camera"), py::arg("pose"), py::arg("far") = false,
      py::arg("spread") = 1.1,
      "Edges measured against where a pose puts them: (n, 9) point, pixel, normal, offset, noise, "
      "steepness.");
  module.def(
      "_row_evidence",
      [](const py::object& image, const Board& board, const Camera& camera, const Pose& first,
         const Pose& last, double spread) -> py::object {
        py::array keep;
        const Picture picture = require_picture(image, "image", keep);
        if (picture.type != PixelType::uint8) throw py::type_error("image must be uint8");
        const LightTable table(camera.response, 3);
        const LightReader light(
            {picture.row(0), picture.width, picture.height, 3, picture.stride()}, table);
        const BoardPattern pattern = pattern_of(board);
        const Lens lens(camera);
        const RowMotion motion = motion_between(first, last);
        const double share = middle_share(pattern, camera, lens, motion.moved(first, 0.5));
        const Rows rows{motion.seen_from(share), share, double(camera.height)};
        const Pose pose = motion.moved(first, share);
        const auto tags = project_tags(pattern, camera, lens, pose, &rows);
        const FoundEdges found = find_edges(light, pattern, tags, {false, 0, spread});
        const auto evidence = row_evidence(found.points, lens, pose, rows);
        if (!evidence) return py::none();
        Doubles information({kRowUnknowns, kRowUnknowns}), change({kRowUnknowns});
        std::copy(evidence->information.begin(), evidence->information.end(),
                  information.mutable_data());
        std::copy(evidence->change.begin(), evidence->change.end(), change.mutable_data());
        return py::make_tuple(share, pose, information, change);
      },
      py::arg("image"), py::arg("board"), py::arg("camera"), py::arg("first"), py::arg("last"),
      py::arg("spread") = 1.1,
      "What a picture's edges alone say of pose and motion: the share of the readout at which the "
      "board's middle row is taken, its pose, and the normal equations (24, 24), (24,) of a change "
      "of (w, d), of its growth in a readout, and of the growth of that and so on; or None.");
  module.def(
      "_track",
      [](const py::object& tags, const py::object& start, const Board& board, const Camera& camera,
         const std::string& method, const std::optional<py::array_t<std::uint8_t>>& grey) {
        Detection detection{require_tags(tags), std::nullopt};
        if (!start.is_none()) detection.start = require_pose(start, "start");
        TrackingOptions options;
        options.method = tracking_method(method);
        std::optional<ImageView<const std::uint8_t>> view;
        if (grey) view = require_grey(*grey);
        const WithoutGil release;
        if (view) return track(detection, *view, board, camera, options);
        return track(detection, board, camera, options);
      },
      py::arg("tags"), py::arg("start"), py::arg("board"), py::arg("camera"),
      py::arg("method") = "board", py::arg("grey") = py::none(),
      "Pose from tags [(id, corners (4, 2))]; with a grey picture, their corners are refined "
      "first.");
  module.def(
      "_track_with",
      [](const py::object& detector, const py::array_t<std::uint8_t>& grey, const Board& board,
         const Camera& camera, const std::string& method, bool refine) {
        const Detector wrapped = make_detector(detector);
        TrackingOptions options;
        options.method = tracking_method(method), options.refine = refine;
        const ImageView<const std::uint8_t> view = require_grey(grey);
        const WithoutGil release;
        return track(wrapped, view, board, camera, options);
      },
      py::arg("detector"), py::arg("grey"), py::arg("board"), py::arg("camera"),
      py::arg("method") = "board", py::arg("refine") = true,
      "One frame as a Session runs it: detector(grey, board, camera) -> (tags, start), refinement, "
      "pose.");
  module.def(
      "_refine_corners",
      [](const py::array_t<std::uint8_t>& grey, const py::object& tags, int border_bits,
         const Camera& camera) {
        const auto picture = require_grey(grey);
        const std::vector<DetectedTag> found = require_tags(tags);
        const WithoutGil release;
        return refine_corners(picture, found, border_bits, camera);
      },
      py::arg("grey"), py::arg("tags"), py::arg("border_bits"), py::arg("camera"),
      "Corners by edges measured in linear light; list of DetectedTag.");
  module.def(
      "_grey",
      [](const py::object& image, const Camera& camera) {
        py::array keep;
        const Picture picture = require_picture(image, "image", keep);
        if (picture.width != camera.width || picture.height != camera.height)
          throw py::value_error("image is " + std::to_string(picture.width) + " x " +
                                std::to_string(picture.height) + ", but the camera is " +
                                std::to_string(camera.width) + " x " +
                                std::to_string(camera.height));
        Image<std::uint8_t> grey;
        {
          const WithoutGil release;
          grey = grey_from(picture, camera.response);
        }
        return image_array(grey);
      },
      py::arg("image"), py::arg("camera"),
      "(height, width) uint8 for detection, of a picture that must have the camera's size.");
}

}  // namespace fastibl::bindings
