#include "fastibl/scene/board.h"

#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "bindings/numpy.h"

namespace fastibl::bindings {
namespace {

Doubles corners_of(const Tag& tag) {
  Doubles out({4, 2});
  for (int i = 0; i < 4; ++i) {
    out.mutable_at(i, 0) = tag.corners[std::size_t(i)].x;
    out.mutable_at(i, 1) = tag.corners[std::size_t(i)].y;
  }
  return out;
}

int tag_id(const py::object& id) {
  if (!PyIndex_Check(id.ptr()))
    throw py::type_error("a tag's id must be a whole number, got " + type_name(id));
  const Py_ssize_t value = PyNumber_AsSsize_t(id.ptr(), PyExc_ValueError);
  if (value == -1 && PyErr_Occurred()) throw py::error_already_set();
  return int(std::clamp<Py_ssize_t>(value, -1, std::numeric_limits<int>::max()));
}

Board board_from(const py::sequence& tags, double width, double height, int border_bits) {
  Board board;
  board.border_bits = border_bits, board.width = width, board.height = height;
  for (const py::handle item : tags) {
    if (!py::isinstance<py::sequence>(item) || py::len(item) != 2)
      throw py::type_error("a tag must be (id, corners), got " + type_name(item));
    const auto pair = py::reinterpret_borrow<py::sequence>(item);
    const Doubles c = require_floats<double>(py::object(pair[1]), "corners");
    if (c.ndim() != 2 || c.shape(0) != 4 || c.shape(1) != 2)
      throw py::value_error("corners must have shape (4, 2), got " + shape_of(c));
    Tag tag{tag_id(pair[0]), {}};
    for (int i = 0; i < 4; ++i) tag.corners[std::size_t(i)] = {c.at(i, 0), c.at(i, 1)};
    board.tags.push_back(tag);
  }
  board.validate();
  return board;
}

std::string millimetres(double metres) {
  return py::str(py::float_(std::round(metres * 1e4) / 10));
}

}  // namespace

void bind_board(py::module_& module) {
  py::class_<Tag>(module, "Tag",
                  "A tag of a board: id, and corners (4, 2) in metres (upper left, upper right, "
                  "lower right, lower left).")
      .def_readonly("id", &Tag::id, "Number in family 36h11, 0 to 586.")
      .def_property_readonly("corners", &corners_of, "(4, 2) float64 metres, marker frame.")
      .def(py::self == py::self)
      .def("__repr__", [](const Tag& t) { return "<fastibl.Tag " + std::to_string(t.id) + ">"; });
  py::class_<Board>(
      module, "Board",
      R"(The printed board: tags of family 36h11 on the plane z = 0 of the marker frame.

tags: [(id, corners (4, 2))], corners of the black border in metres, x right, y up, origin at the page's centre:
upper left, upper right, lower right, lower left as the tag is read. border_bits: width of the black border in
modules. width, height: of the page in metres. Raises ValueError for no tags, or an id that occurs twice or is outside 0
to 586.)")
      .def(py::init(&board_from), py::arg("tags"), py::arg("width"), py::arg("height"),
           py::arg("border_bits") = 1)
      .def_static("default", &Board::default_board,
                  "A large tag with small ones around it, on A4 landscape: it can be seen near, "
                  "far and partly hidden.")
      .def_static("grid", &Board::grid, py::arg("rows"), py::arg("columns"), py::arg("tag_size"),
                  py::arg("spacing"), py::arg("border_bits") = 1,
                  "A grid of rows x columns tags of tag_size metres, spacing metres apart; ids "
                  "from 0, row by row from the top. Raises ValueError for less than one tag or "
                  "lengths that are not positive.")
      .def_static("kalibr", &Board::kalibr, py::arg("rows"), py::arg("columns"),
                  py::arg("tag_size"), py::arg("spacing_ratio") = 0.3,
                  "Kalibr's AprilGrid: two-module borders, ids from 0, row by row from the bottom; "
                  "spacing_ratio = space between tags / tag_size (metres). Raises ValueError for "
                  "less than one tag or lengths that are not positive.")
      .def_readonly("tags", &Board::tags, "List of Tag.")
      .def_readonly("border_bits", &Board::border_bits, "Width of the black border in modules.")
      .def_readonly("width", &Board::width, "Page width in metres.")
      .def_readonly("height", &Board::height, "Page height in metres.")
      // Drawing is done in Python, because the library reads and writes no files; the method is
      // bound here so that there is one class only.
      .def(
          "image",
          [](const py::object& self, double dpi) {
            return py::module_::import("fastibl.board").attr("draw_board")(self, dpi);
          },
          py::arg("dpi") = 300.0,
          "The page as (height, width) uint8 grey values, white 255; pixels at edges have the "
          "exact coverage. Pixel (0, 0) is the page's upper left corner. Raises ValueError for dpi "
          "outside 10 to 2400.")
      .def(
          "save",
          [](const py::object& self, const py::object& path, double dpi) {
            py::module_::import("fastibl.board").attr("save_board")(self, path, dpi);
          },
          py::arg("path"), py::arg("dpi") = 300.0,
          R"(Writes the page at true size: .png with its resolution inside, or .pdf as vectors (needs
reportlab). Print at 100 % and measure the line below the tags. Raises ValueError for another ending.)")
      .def(py::self == py::self)
      .def("__repr__",
           [](const Board& b) {
             return "<fastibl.Board of " + std::to_string(b.tags.size()) + " tags, " +
                    millimetres(b.width) + " x " + millimetres(b.height) + " mm>";
           })
      .def("__copy__", [](const Board& b) { return b; })
      .def(
          "__deepcopy__", [](const Board& b, const py::dict&) { return b; }, py::arg("memo"))
      .def(py::pickle(
          [](const Board& b) {
            py::list tags;
            for (const Tag& tag : b.tags) tags.append(py::make_tuple(tag.id, corners_of(tag)));
            return py::make_tuple(tags, b.width, b.height, b.border_bits);
          },
          [](const py::tuple& t) {
            return board_from(t[0], t[1].cast<double>(), t[2].cast<double>(), t[3].cast<int>());
          }));
}

}  // namespace fastibl::bindings
