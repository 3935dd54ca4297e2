#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <array>
#include <optional>
#include <sstream>

#include "bindings/numpy.h"
#include "bindings/one_at_a_time.h"
#include "bindings/spheres.h"
#include "fastibl/lighting/find_near_lights.h"
#include "fastibl/lighting/harmonic_sums.h"
#include "fastibl/shadow/fit_spheres.h"
#include "fastibl/shadow/ratio_at.h"
#include "fastibl/shadow/sphere_shadow.h"

namespace fastibl::bindings {
namespace {

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
  if (method == ShadowMethod::mesh)
    throw py::value_error("\"mesh\" is the method of fastibl.MeshShadow, not of spheres");
  return method == ShadowMethod::automatic ? ShadowMethod::directions : method;
}

glm::vec3 plane_irradiance(const CubeMap& cube) {
  return glm::vec3(plane_irradiance(fold(cube, 32)));
}

ShadowOptions require_options(const std::string& method, int directions, int resolution,
                              const std::optional<float>& extent, const py::object& centre,
                              bool outer) {
  ShadowOptions options;
  options.method = require_method(method);
  options.settings.directions = directions;
  options.resolution = resolution;
  options.outer = outer;
  if (extent) {
    options.extent = *extent;
    if (!(options.extent > 0))
      throw py::value_error("extent must be above 0 metres, got " + std::to_string(options.extent));
  }
  if (!centre.is_none()) {
    const Floats array = require_floats<float>(centre, "centre");
    if (array.ndim() != 1 || array.size() != 2)
      throw py::value_error("centre must have shape (2,), got " + shape_of(array));
    options.centre = glm::vec2(array.at(0), array.at(1));
  }
  return options;
}

// The array in which the caller wants results: itself, not a copy.
Floats require_results(const py::object& given, const std::vector<py::ssize_t>& shape) {
  if (!py::isinstance<Floats>(given) || !py::cast<py::array>(given).writeable())
    throw py::type_error("out must be a writeable C-contiguous float32 array");
  Floats out = py::reinterpret_borrow<Floats>(given);
  if (shape_vector(out) != shape)
    throw py::value_error("out must have one RGB for each point, got shape " + shape_of(out));
  return out;
}

// A read-only view of a map's image.
py::object image_view(const py::object& owner, const Image<float>& image) {
  const py::ssize_t n = image.width, s = sizeof(float);
  py::array view(py::dtype::of<float>(), {n, n, py::ssize_t{3}}, {3 * n * s, 3 * s, s},
                 image.data.data(), owner);
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

// (k, 3) directions and (k, 3) shares.
py::tuple direction_arrays(std::span<const LightDirection> light) {
  Floats directions({py::ssize_t(light.size()), py::ssize_t{3}});
  Floats shares({py::ssize_t(light.size()), py::ssize_t{3}});
  for (std::size_t k = 0; k < light.size(); ++k) {
    vectors(directions)[k] = light[k].direction;
    vectors(shares)[k] = light[k].share;
  }
  return py::make_tuple(directions, shares);
}

}  // namespace

void bind_shadow(py::module_& module) {
  module.def(
      "fit_spheres",
      [](const Mesh& mesh, int count, int resolution, unsigned seed) {
        SphereSet spheres;
        {
          const WithoutGil release;
          spheres = fit_spheres(mesh, {count, resolution, seed});
        }
        py::array_t<float> out({py::ssize_t(spheres.size()), py::ssize_t{4}});
        std::memcpy(out.mutable_data(), spheres.data(), spheres.size() * sizeof(glm::vec4));
        return out;
      },
      py::arg("mesh"), py::arg("count") = 50, py::arg("resolution") = 64, py::arg("seed") = 0u,
      R"(Fills a mesh with spheres, for its shadow: (m, 4) float32, x y z radius in the mesh's frame, 1 <= m <= count.

resolution: voxels along the longest edge. seed: another seed gives another set, about as good; the same seed gives the
same bits. The mesh may be open, flipped or torn; a mesh that encloses nothing gets spheres spread over its surface.
Raises ValueError for count < 1 or resolution outside [8, 128].)");

  const auto map_state = [](const ShadowMap& m) {
    return py::make_tuple(image_array(m.ratio), std::array{m.centre.x, m.centre.y}, m.extent,
                          image_array(m.outer), m.outer_extent, image_array(m.fine),
                          std::array{m.fine_centre.x, m.fine_centre.y}, m.fine_extent, m.range,
                          m.ignored_spheres, m.no_light);
  };
  const auto map_from_state = [](const py::tuple& t) {
    const auto point = [&](std::size_t k) {
      const auto [x, y] = t[k].cast<std::array<float, 2>>();
      return glm::vec2(x, y);
    };
    ShadowMap m;
    m.ratio = image_from(t[0], 3), m.centre = point(1), m.extent = t[2].cast<float>();
    m.outer = image_from(t[3], 3), m.outer_extent = t[4].cast<float>();
    m.fine = image_from(t[5], 3), m.fine_centre = point(6), m.fine_extent = t[7].cast<float>();
    m.range = t[8].cast<float>(), m.ignored_spheres = t[9].cast<int>();
    m.no_light = t[10].cast<bool>();
    return m;
  };
  py::class_<ShadowMap, std::shared_ptr<ShadowMap>>(
      module, "ShadowMap",
      R"(Ratio of the light on the marker plane with and without the object.

It has a fine map around the object and, with most methods, a coarse one around that; both have the same centre, and the
fine map blends into the coarse one at its border. Beyond both the ratio is 1.)")
      .def_property_readonly(
          "image",
          [](const py::object& self) {
            return image_view(self, self.cast<const ShadowMap&>().ratio);
          },
          "(n, n, 3) float32, a read-only view; row 0 is y min, column 0 is x min. In [0, 1]; a "
          "plane "
          "gain may exceed 1.")
      .def_readonly("extent", &ShadowMap::extent, "Half the edge of `image` in metres.")
      .def_property_readonly(
          "outer",
          [](const py::object& self) {
            const Image<float>& outer = self.cast<const ShadowMap&>().outer;
            return outer.empty() ? py::object(py::none()) : image_view(self, outer);
          },
          "The coarse map (m, m, 3) float32, a read-only view; None where there is none.")
      .def_readonly("outer_extent", &ShadowMap::outer_extent,
                    "Half the edge of `outer` in metres; 0 where there is none.")
      .def_property_readonly(
          "fine",
          [](const py::object& self) {
            const Image<float>& fine = self.cast<const ShadowMap&>().fine;
            return fine.empty() ? py::object(py::none()) : image_view(self, fine);
          },
          "A finer map where a compact light casts its shadow, (k, k, 3) float32, with all light; "
          "None where there is none.")
      .def_readonly("fine_extent", &ShadowMap::fine_extent,
                    "Half the edge of `fine` in metres; 0 where there is none.")
      .def_property_readonly(
          "fine_centre",
          [](const ShadowMap& map) { return py::make_tuple(map.fine_centre.x, map.fine_centre.y); },
          "(x, y) of the middle of `fine`, metres, marker frame.")
      .def_property_readonly(
          "reach", &ShadowMap::reach,
          "Half the edge of all maps together in metres; outside, the ratio is 1.")
      .def_property_readonly(
          "centre", [](const ShadowMap& map) { return py::make_tuple(map.centre.x, map.centre.y); },
          "(x, y) of the map's middle, metres, marker frame.")
      .def_readonly("ignored_spheres", &ShadowMap::ignored_spheres,
                    "Number of spheres that were not finite or had a radius of 0 or less.")
      .def_readonly("no_light", &ShadowMap::no_light,
                    "True when nothing lights the plane: the ratio is 1 everywhere.")
      .def(py::pickle(map_state, map_from_state))
      .def(
          "sample",
          [](const ShadowMap& map, const py::object& points, const py::object& given) {
            const Floats in = require_points(points);
            std::vector<py::ssize_t> shape = shape_vector(in);
            shape.back() = 3;
            Floats out = given.is_none() ? Floats(shape) : require_results(given, shape);
            {
              const WithoutGil release;
              map.sample(as_points(in), {vectors(out), std::size_t(in.size() / 2)});
            }
            return out;
          },
          py::arg("points"), py::arg("out") = py::none(),
          R"(Ratio (..., 3) float32 at plane points (..., 2) in metres, bilinear; 1 outside.

out: C-contiguous float32 array for the result, which is returned; without it a new array is made. Raises ValueError for
another shape, TypeError for another kind of array.)")
      .def(py::self == py::self)
      .def("__repr__", [](const ShadowMap& map) {
        std::ostringstream text;
        text << "<fastibl.ShadowMap " << map.ratio.width << " x " << map.ratio.height << ", extent "
             << map.extent << " m";
        if (!map.outer.empty())
          text << ", outer " << map.outer.width << " x " << map.outer.height << ", extent "
               << map.outer_extent << " m";
        text << ">";
        return text.str();
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
          const WithoutGil release;
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

spheres: (m, 4), x y z radius in metres, marker frame.
points: (..., 2) metres.
method: "directions" (the default, "auto"; correct where spheres overlap), or the paper's methods: "cap-sum" adds what
the spheres hold back, "cap-product" multiplies what they let through.
directions: how many directions stand for all light in the method "directions", 8 to 4096; the root mean square error of
the ratio against all texels is about 0.009, 0.0034, 0.0012 for 64, 256, 1024.
A channel without light has ratio 1, a point in a sphere has 0; spheres that are not finite, have a radius of 0 or less,
or lie below the plane are ignored.
Raises ValueError for another shape, method or number, TypeError for integers.)");
  module.def(
      "cast_shadow",
      [](const CubeMap& cube, const py::object& spheres, const std::string& method, int resolution,
         const std::optional<float>& extent, const py::object& centre, int directions, bool outer) {
        const ShadowOptions options =
            require_options(method, directions, resolution, extent, centre, outer);
        const SphereSet set = require_spheres(spheres);
        const WithoutGil release;
        return cast_shadow(cube, plane_irradiance(cube), set, options);
      },
      py::arg("cube"), py::arg("spheres"), py::arg("method") = "auto", py::arg("resolution") = 0,
      py::arg("extent") = py::none(), py::arg("centre") = py::none(), py::arg("directions") = 256,
      py::arg("outer") = true,
      R"(ShadowMap of spheres, see shadow_ratio.

resolution: texels along an edge; 0 means the method's default: 128 for "directions", 64 for the others.
extent: half the map's edge in metres, by default 3 times the spheres' half width or half height.
centre: (x, y), by default the middle of the spheres.
outer: whether "directions" adds a coarse map around it, large enough that what is left out is at most 1/510, but at
most eight times the extent; without it, and with the other methods, the ratio fades to 1 over the outer tenth of the
map.
Raises ValueError for another shape or method and for numbers out of range.)");
  py::class_<DirectionShadow>(
      module, "DirectionShadow",
      R"(Casts the shadows of one object, frame by frame, with the method "directions".

The directions stay where they are while the light changes, so that nothing flickers; when the light has moved, they are
chosen anew and faded in over 32 maps. What a pose hides is kept as long as the pose does not change; when nothing
changed, the last map is returned. directions: how many stand for all light, see light_directions. Raises ValueError outside 8 to 4096.)")
      .def(py::init<int>(), py::arg("directions") = 256)
      .def(
          "cast",
          [](DirectionShadow& self, const py::object& map, const py::object& spheres,
             int resolution, const std::optional<float>& extent, const py::object& centre,
             bool outer) {
            const bool known = py::isinstance<Environment>(map);
            if (!known && !py::isinstance<CubeMap>(map))
              throw py::type_error("cube must be CubeMap or Environment, got " + type_name(map));
            const Environment* environment = known ? &map.cast<const Environment&>() : nullptr;
            const CubeMap& cube = known ? environment->radiance : map.cast<const CubeMap&>();
            const ShadowOptions options =
                require_options("directions", 256, resolution, extent, centre, outer);
            const SphereSet set = require_spheres(spheres);
            return one_at_a_time(&self, [&] {
              return std::const_pointer_cast<ShadowMap>(self.cast(
                  cube, set, options, environment ? find_near_lights(*environment) : NearLights{}));
            });
          },
          py::arg("cube"), py::arg("spheres"), py::arg("resolution") = 0,
          py::arg("extent") = py::none(), py::arg("centre") = py::none(), py::arg("outer") = true,
          "ShadowMap of spheres (m, 4) under a CubeMap or an Environment; near lights of an "
          "Environment cast the shadow from where they are. See cast_shadow.")
      .def_property_readonly(
          "light",
          [](const DirectionShadow& self) {
            const auto light = one_at_a_time(
                &self, [&] { return std::vector<LightDirection>(self.light().directions()); });
            return direction_arrays(light);
          },
          "Directions (k, 3) and shares (k, 3) of the last cast, see light_directions; twice as "
          "many "
          "while new ones are faded in.");
  module.def(
      "light_directions",
      [](const CubeMap& cube, int count) {
        std::vector<LightDirection> light;
        {
          const WithoutGil release;
          light = light_directions(cube, count);
        }
        return direction_arrays(light);
      },
      py::arg("cube"), py::arg("count") = 256,
      R"(Directions that stand for all light on the plane z = 0: unit vectors (k, 3) towards it, marker frame, and their shares
(k, 3) of the plane's irradiance, which sum to 1 in each channel with light. Both are float32.

count: k where the channels' light comes from the same places, as on real maps; otherwise up to three times as many, so
that each channel has as many of its own. Without light there are none, (0, 3). Raises ValueError for a count outside
[8, 4096].)");
}

}  // namespace fastibl::bindings
