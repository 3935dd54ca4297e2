// A Python callable as a Detector. The GIL is held only while it is called.
#pragma once

#include <memory>
#include <utility>

#include "bindings/numpy.h"
#include "fastibl/tracking/detector.h"

namespace fastibl::bindings {

inline std::array<glm::dvec2, 4> require_corners(const py::handle& object, const char* name) {
  const Doubles c = require_floats<double>(py::reinterpret_borrow<py::object>(object), name);
  if (c.ndim() != 2 || c.shape(0) != 4 || c.shape(1) != 2)
    throw py::value_error(std::string(name) + " must have shape (4, 2), got " + shape_of(c));
  std::array<glm::dvec2, 4> corners;
  for (int i = 0; i < 4; ++i) corners[std::size_t(i)] = {c.at(i, 0), c.at(i, 1)};
  return corners;
}

inline py::array corners_array(const std::array<glm::dvec2, 4>& corners) {
  Doubles out({4, 2});
  for (int i = 0; i < 4; ++i) {
    out.mutable_at(i, 0) = corners[std::size_t(i)].x;
    out.mutable_at(i, 1) = corners[std::size_t(i)].y;
  }
  return out;
}

// [(id, corners (4, 2)), …] as detectors return it.
inline std::vector<DetectedTag> require_tags(const py::handle& object) {
  std::vector<DetectedTag> tags;
  for (const py::handle item : py::reinterpret_borrow<py::iterable>(object)) {
    if (py::isinstance<DetectedTag>(item)) {
      tags.push_back(item.cast<DetectedTag>());
      continue;
    }
    if (!py::isinstance<py::sequence>(item) || py::len(item) != 2)
      throw py::type_error("a detected tag must be (id, corners), got " + type_name(item));
    const auto pair = py::reinterpret_borrow<py::sequence>(item);
    tags.push_back({py::int_(py::object(pair[0])).cast<int>(),
                    require_corners(py::object(pair[1]), "corners of a detected tag")});
  }
  return tags;
}

// callable: f(grey (height, width) uint8, read only, board, camera) ->
// (list of (id, corners (4, 2)), start), corners with pixel centres at + 0.5 in the order of
// Tag.corners, start camera_from_marker as Pose or (4, 4), or None. What it raises passes through.
inline Detector make_detector(py::object callable) {
  if (!PyCallable_Check(callable.ptr()))
    throw py::type_error("a detector must be callable, got " + type_name(callable));
  // Copies of the Detector may be dropped on threads without the GIL.
  const std::shared_ptr<py::object> shared(new py::object(std::move(callable)), [](py::object* o) {
    const WithGil gil;
    delete o;
  });
  return [shared](ImageView<const std::uint8_t> grey, const Board& board, const Camera& camera) {
    const WithGil gil;
    // A copy, which the detector may keep.
    const py::array_t<std::uint8_t> picture({py::ssize_t{grey.height}, py::ssize_t{grey.width}},
                                            {py::ssize_t{grey.stride()}, py::ssize_t{1}},
                                            grey.data);
    picture.attr("setflags")(py::arg("write") = false);
    const py::object found = (*shared)(picture, board, camera);
    if (!py::isinstance<py::sequence>(found) || py::len(found) != 2)
      throw py::type_error("a detector must return (tags, start), got " + type_name(found));
    const auto pair = py::reinterpret_borrow<py::sequence>(found);
    Detection detection{require_tags(py::object(pair[0])), std::nullopt};
    const py::object start = pair[1];
    if (!start.is_none()) detection.start = require_pose(start, "start");
    return detection;
  };
}

}  // namespace fastibl::bindings
