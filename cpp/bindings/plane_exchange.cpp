#include "fastibl/shading/plane_exchange.h"

#include <algorithm>

#include "bindings/numpy.h"
#include "bindings/progress.h"
#include "fastibl/core/check.h"
#include "fastibl/shading/bake_visibility.h"
#include "fastibl/shading/bounce.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl::bindings {
namespace {

PlaneExchange of_mesh(const Mesh& mesh, int cells) {
  const WithoutGil release;
  VisibilityOptions options;
  options.size = 32;
  return PlaneExchange(mesh, mesh_visibility(mesh, options, let_signals_through), cells);
}

void require_finite(const Floats& exitance) {
  for (py::ssize_t i = 0; i < exitance.size(); ++i)
    if (!std::isfinite(exitance.data()[i]))
      throw py::value_error("exitance must be finite, got " + std::to_string(exitance.data()[i]));
}

Image<float> require_cells(const py::object& object, const PlaneExchange& exchange) {
  const Floats array = require_vectors(object, "exitance");
  const py::ssize_t n = exchange.cells();
  if (array.ndim() != 3 || array.shape(0) != n || array.shape(1) != n)
    throw py::value_error("exitance must have shape (" + std::to_string(n) + ", " +
                          std::to_string(n) + ", 3), got " + shape_of(array));
  require_finite(array);
  Image<float> image(exchange.cells(), exchange.cells(), 3);
  std::copy_n(array.data(), array.size(), image.data.begin());
  return image;
}

// What a scene's object and the plane exchange under one light.
struct SceneBounce {
  Scene scene;
  PlaneExchange exchange;
  CellLight light;
  std::vector<glm::vec4> shares;
  ShadowMap gain;

  explicit SceneBounce(const Scene& given) : scene(given) {
    check(scene.directions != nullptr, "a bounce needs a scene with its visibility_rays");
    exchange = PlaneExchange(scene.mesh, *scene.directions, 32, scene.marker_from_object);
  }
  void update(const Lighting& lighting, const ShadowMap& shadow) {
    check(lighting.radiance != nullptr, "a bounce needs a lighting with its map");
    const glm::mat3 marker_from_object(scene.marker_from_object.rotation);
    shares.assign(scene.directions->entries(), glm::vec4(1));
    light.update(*lighting.radiance, glm::transpose(marker_from_object), scene.directions->size);
    diffuse_shares(*scene.directions, light, lighting.irradiance, scene.normals, marker_from_object,
                   shares);
    const Bounce bounce = find_bounce(exchange, scene, lighting, shadow, shares);
    add_shares(bounce, shares);
    gain = plane_gain(shadow, scene.shadow_look, bounce);
  }
};

}  // namespace

void bind_plane_exchange(py::module_& module) {
  py::class_<PlaneExchange>(
      module, "PlaneExchange",
      R"(Diffuse light from an object to the marker plane on which it stands, and back: one bounce.

mesh: Mesh standing on z = 0. cells: number of cells of the plane along an edge, 1 to 128; they cover 1.5 times the
object's largest extent to each side. Form factors between vertices and cells are computed once (Goral et al. 1984); the
light in both directions is then a sum. Raises ValueError for another number of cells.)")
      .def(py::init(&of_mesh), py::arg("mesh"), py::kw_only(), py::arg("cells") = 32)
      .def(
          "onto_plane",
          [](const PlaneExchange& exchange, const py::object& exitance) {
            const Floats in = require_vectors(exitance, "exitance");
            require_finite(in);
            return image_array(exchange.onto_plane({vectors(in), std::size_t(in.size() / 3)}));
          },
          py::arg("exitance"),
          R"(Irradiance of the cells (cells, cells, 3), float32; row 0 has the smallest y.

exitance: (v, 3) light that each vertex sends out, which is its irradiance times its diffuse reflectance.
Raises ValueError for another number of vertices, and for what is not finite.)")
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
          R"(Irradiance of each vertex (v, 3) from cells that send out exitance (cells, cells, 3).

This is linear, so it also works for changes, such as the light that a shadow on the plane takes from the object. Raises
ValueError for another shape and what is not finite, TypeError for integers.)")
      .def_property_readonly("cells", &PlaneExchange::cells, "Number of cells along an edge.")
      .def_property_readonly("extent", &PlaneExchange::extent,
                             "Half the edge of the area of all cells, metres.")
      .def_property_readonly(
          "centre",
          [](const PlaneExchange& e) { return py::make_tuple(e.centre().x, e.centre().y); },
          "Middle of the cells (x, y), metres, in the mesh's frame.");
  py::class_<SceneBounce>(
      module, "Bounce",
      R"(One bounce of diffuse light between a scene's object and the plane, for other renderers.

scene: Scene with its object in place. Raises ValueError for a scene without visibility_rays.)")
      .def(py::init<const Scene&>(), py::arg("scene"), py::call_guard<WithoutGil>())
      .def("update", &SceneBounce::update, py::arg("lighting"), py::arg("shadow"),
           py::call_guard<WithoutGil>(),
           "Computes the bounce for a Lighting and the object's ShadowMap under it.")
      .def_property_readonly(
          "shares",
          [](const SceneBounce& b) {
            const std::size_t count =
                std::min(b.shares.size(), b.scene.given_mesh().vertices.size());
            Floats out({py::ssize_t(count), py::ssize_t{3}});
            for (std::size_t i = 0; i < count; ++i) vectors(out)[i] = glm::vec3(b.shares[i]);
            return out;
          },
          "Share of the map's irradiance that reaches each vertex of the scene's mesh (v, 3): "
          "without what the object hides and what its shadow takes from the plane below.")
      .def_property_readonly(
          "plane_gain", [](const SceneBounce& b) { return b.gain; },
          "ShadowMap by which the picture of the plane is multiplied; it may exceed 1.");
}

}  // namespace fastibl::bindings
