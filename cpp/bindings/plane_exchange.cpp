#include "fastibl/shading/plane_exchange.h"

#include "bindings/numpy.h"
#include "fastibl/shading/bake_visibility.h"

namespace fastibl::bindings {
namespace {

PlaneExchange of_mesh(const Mesh& mesh, int cells) {
  const py::gil_scoped_release release;
  VisibilityOptions options;
  options.size = 32;
  return PlaneExchange(mesh, mesh_visibility(mesh, options), cells);
}

Image<float> require_cells(const py::object& object, const PlaneExchange& exchange) {
  const Floats array = require_vectors(object, "exitance");
  const py::ssize_t n = exchange.cells();
  if (array.ndim() != 3 || array.shape(0) != n || array.shape(1) != n)
    throw py::value_error("exitance must have shape (" + std::to_string(n) + ", " +
                          std::to_string(n) + ", 3), got " + shape_of(array));
  Image<float> image(exchange.cells(), exchange.cells(), 3);
  std::copy_n(array.data(), array.size(), image.data.begin());
  return image;
}

}  // namespace

void bind_plane_exchange(py::module_& module) {
  py::class_<PlaneExchange>(
      module, "PlaneExchange",
      R"(Diffuse light from an object to the marker plane that it stands on, and back: one bounce.

mesh: Mesh standing on z = 0. cells: of the plane along an edge, 1 to 128, over 1.5 times the object's largest extent
to each side. Form factors between vertices and cells are worked out once (Goral et al. 1984); then both ways are sums.
Raises ValueError for another number of cells.)")
      .def(py::init(&of_mesh), py::arg("mesh"), py::kw_only(), py::arg("cells") = 32)
      .def(
          "onto_plane",
          [](const PlaneExchange& exchange, const py::object& exitance) {
            const Floats in = require_vectors(exitance, "exitance");
            return image_array(exchange.onto_plane({vectors(in), std::size_t(in.size() / 3)}));
          },
          py::arg("exitance"),
          R"(Irradiance of the cells (cells, cells, 3), row 0 at least y, float32.

exitance: (v, 3) light that each vertex sends out: its irradiance times its diffuse reflectance.
Raises ValueError for another number of vertices.)")
      .def(
          "onto_object",
          [](const PlaneExchange& exchange, const py::object& exitance) {
            const std::vector<glm::vec3> light =
                exchange.onto_object(require_cells(exitance, exchange));
            Floats out({py::ssize_t(light.size()), py::ssize_t{3}});
            std::copy(light.begin(), light.end(), vectors(out));
            return out;
          },
          py::arg("exitance"),
          R"(Irradiance of each vertex (v, 3) by cells that send out exitance (cells, cells, 3).

Linear, and so good for changes as well: what a shadow on the plane takes from the object.)")
      .def_property_readonly("cells", &PlaneExchange::cells)
      .def_property_readonly("extent", &PlaneExchange::extent,
                             "Half the edge of all cells together, metres.")
      .def_property_readonly(
          "centre",
          [](const PlaneExchange& e) { return py::make_tuple(e.centre().x, e.centre().y); },
          "Middle of the cells (x, y), metres, the mesh's frame.");
}

}  // namespace fastibl::bindings
