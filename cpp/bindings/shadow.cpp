#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <optional>

#include "bindings/numpy.h"
#include "fastibl/lighting/irradiance_sums.h"
#include "fastibl/shadow/fit_spheres.h"
#include "fastibl/shadow/ratio_at.h"
#include "fastibl/shadow/sphere_shadow.h"

namespace fastibl::bindings {
namespace {

SphereSet require_spheres(const py::object& object) {
  const Floats array = require_floats<float>(object, "spheres");
  if (array.ndim() != 2 || array.shape(1) != 4)
    throw py::value_error("spheres must have shape (m, 4), got " + shape_of(array));
  SphereSet spheres;
  for (const float* s = array.data(); s < array.data() + array.size(); s += 4)
    spheres.push_back({s[0], s[1], s[2], s[3]});
  return spheres;
}

// (..., 2) of any float dtype.
Floats require_points(const py::object& object) {
  const Floats array = require_floats<float>(object, "points");
  if (array.ndim() < 1 || array.shape(array.ndim() - 1) != 2)
    throw py::value_error("points must have shape (..., 2), got " + shape_of(array));
  return array;
}

std::span<const glm::vec2> as_points(const Floats& array) {
  return {reinterpret_cast<const glm::vec2*>(array.data()), std::size_t(array.size() / 2)};
}

Floats colours_at(const Floats& points, const std::vector<glm::vec3>& colours) {
  std::vector<py::ssize_t> shape = shape_vector(points);
  shape.back() = 3;
  Floats out(shape);
  std::copy(colours.begin(), colours.end(), vectors(out));
  return out;
}

ShadowMethod require_method(const std::string& text) {
  const ShadowMethod method = shadow_method(text);
  return method == ShadowMethod::automatic ? ShadowMethod::directions : method;
}

glm::vec3 plane_irradiance(const CubeMap& cube) {
  return glm::vec3(sum_irradiance(fold(cube, 32), {0, 0, 1}));
}

ShadowMap cast(const CubeMap& cube, const py::object& spheres, const std::string& method,
               int resolution, const std::optional<float>& extent, const py::object& centre) {
  ShadowOptions options{require_method(method), resolution, 0, {}};
  if (extent) {
    options.extent = *extent;
    if (!(options.extent > 0)) throw py::value_error("extent must be above 0 metres");
  }
  if (!centre.is_none()) {
    const Floats array = require_floats<float>(centre, "centre");
    if (array.ndim() != 1 || array.size() != 2)
      throw py::value_error("centre must have shape (2,), got " + shape_of(array));
    options.centre = glm::vec2(array.at(0), array.at(1));
  }
  const SphereSet set = require_spheres(spheres);
  const py::gil_scoped_release release;
  return cast_shadow(cube, plane_irradiance(cube), set, options);
}

}  // namespace

void bind_shadow(py::module_& module) {
  module.def(
      "fit_spheres",
      [](const Mesh& mesh, int count, int resolution, unsigned seed) {
        SphereSet spheres;
        {
          const py::gil_scoped_release release;
          spheres = fit_spheres(mesh, {count, resolution, seed});
        }
        py::array_t<float> out({py::ssize_t(spheres.size()), py::ssize_t{4}});
        std::memcpy(out.mutable_data(), spheres.data(), spheres.size() * sizeof(glm::vec4));
        return out;
      },
      py::arg("mesh"), py::arg("count") = 50, py::arg("resolution") = 64, py::arg("seed") = 0u,
      R"(Spheres that fill a mesh, for its shadow: (m, 4) float32, x y z radius in the mesh's frame, 1 <= m <= count.

resolution: voxels along the longest edge. seed: another gives another set, about as good; the same gives the same
bits. The mesh may be open, flipped or torn; one that encloses nothing gets spheres spread over its surface. Raises ValueError for count < 1 or resolution outside
[8, 128].)");

  py::class_<ShadowMap>(module, "ShadowMap",
                        R"(Ratio of the light on the marker plane with and without the object.)")
      .def_property_readonly(
          "image",
          [](const py::object& self) {
            const ShadowMap& map = self.cast<const ShadowMap&>();
            const py::ssize_t n = map.ratio.width, s = sizeof(float);
            py::array view(py::dtype::of<float>(), {n, n, py::ssize_t{3}}, {3 * n * s, 3 * s, s},
                           map.ratio.data.data(), self);
            view.attr("setflags")(py::arg("write") = false);
            return view;
          },
          "(n, n, 3) float32 in [0, 1], a read-only view; row 0 is y min, column 0 is x min.")
      .def_readonly("extent", &ShadowMap::extent,
                    "Half the edge in metres; outside the ratio is 1.")
      .def_property_readonly(
          "centre", [](const ShadowMap& map) { return py::make_tuple(map.centre.x, map.centre.y); },
          "(x, y) of the map's middle, metres, marker frame.")
      .def_readonly("ignored_spheres", &ShadowMap::ignored_spheres,
                    "Number of spheres that were not finite or had a radius of 0 or less.")
      .def_readonly("no_light", &ShadowMap::no_light,
                    "True when nothing lights the plane: the ratio is 1 everywhere.")
      .def(
          "sample",
          [](const ShadowMap& map, const py::object& points) {
            const Floats in = require_points(points);
            std::vector<glm::vec3> colours;
            for (const glm::vec2 p : as_points(in)) colours.push_back(map.sample(p));
            return colours_at(in, colours);
          },
          py::arg("points"),
          "Ratio (..., 3) float32 at plane points (..., 2) in metres, bilinear; 1 outside.")
      .def(py::self == py::self)
      .def("__repr__", [](const ShadowMap& map) {
        return "<fastibl.ShadowMap " + std::to_string(map.ratio.width) + " x " +
               std::to_string(map.ratio.height) + ", extent " + std::to_string(map.extent) + " m>";
      });

  module.def(
      "shadow_ratio",
      [](const CubeMap& cube, const py::object& spheres, const py::object& points,
         const std::string& method, int directions) {
        const ShadowMethod chosen = require_method(method);
        const SphereSet set = require_spheres(spheres);
        const Floats in = require_points(points);
        std::vector<glm::vec3> ratios;
        {
          const py::gil_scoped_release release;
          if (chosen == ShadowMethod::directions)
            ratios = ratio_at(as_points(in), set, light_directions(cube, directions));
          else
            ratios = shadow_ratio(cube, plane_irradiance(cube), set, as_points(in), chosen);
        }
        return colours_at(in, ratios);
      },
      py::arg("cube"), py::arg("spheres"), py::arg("points"), py::arg("method") = "auto",
      py::arg("directions") = 256,
      R"(Ratio of the light on the plane z = 0 with and without spheres: (..., 3) float32 in [0, 1].

spheres: (m, 4), x y z radius in metres, marker frame. points: (..., 2) metres. method: "cap-sum" adds what the
spheres hold back, "cap-product" multiplies what they let through; "auto" takes the better. A channel without light
has ratio 1, a point in or on a sphere 0; spheres that are not finite, have a radius of 0 or less, or lie below the
plane are ignored. Raises ValueError for another shape or method, TypeError for integers.)");
  module.def("cast_shadow", &cast, py::arg("cube"), py::arg("spheres"), py::arg("method") = "auto",
             py::arg("resolution") = 64, py::arg("extent") = py::none(),
             py::arg("centre") = py::none(),
             R"(ShadowMap of spheres, see shadow_ratio.

extent: half the map's edge in metres, by default 3 times the spheres' half width. centre: (x, y), by default the
middle of the spheres. The ratio fades to 1 over the outer tenth of the map.)");
}

}  // namespace fastibl::bindings
