#include "fastibl/scene/mesh.h"

#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <limits>
#include <string>
#include <vector>

#include "bindings/numpy.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/obj_file.h"
#include "fastibl/scene/rounded_places.h"

namespace fastibl::bindings {
namespace {

Mesh make_mesh(const py::object& vertices, const py::object& triangles, const py::object& uvs,
               const py::object& normals, const py::object& colors) {
  const Floats v = require_vectors(vertices, "vertices");
  if (v.ndim() != 2) throw py::value_error("vertices must have shape (v, 3), got " + shape_of(v));
  const py::array t = py::array::ensure(triangles);
  if (!t || (t.dtype().kind() != 'i' && t.dtype().kind() != 'u')) {
    PyErr_Clear();
    throw py::type_error("triangles must hold integers");
  }
  if (t.ndim() != 2 || t.shape(1) != 3)
    throw py::value_error("triangles must have shape (t, 3), got " + shape_of(t));
  const auto wide = py::array_t<long long, py::array::c_style | py::array::forcecast>::ensure(t);
  Mesh mesh;
  mesh.vertices.assign(vectors(v), vectors(v) + v.shape(0));
  for (py::ssize_t i = 0; i < wide.shape(0); ++i) {
    glm::ivec3 triangle;
    for (int c = 0; c < 3; ++c) {
      triangle[c] = int(wide.at(i, c));
      if (triangle[c] != wide.at(i, c))
        throw py::value_error("triangle " + std::to_string(i) + " has vertex index " +
                              std::to_string(wide.at(i, c)) + ", expected 0 to " +
                              std::to_string(v.shape(0) - 1));
    }
    mesh.triangles.push_back(triangle);
  }
  if (!uvs.is_none()) {
    const Floats uv = require_floats<float>(uvs, "uvs");
    if (uv.ndim() != 2 || uv.shape(1) != 2)
      throw py::value_error("uvs must have shape (v, 2), got " + shape_of(uv));
    for (py::ssize_t i = 0; i < uv.shape(0); ++i) mesh.uvs.push_back({uv.at(i, 0), uv.at(i, 1)});
  }
  if (!normals.is_none()) {
    const Floats n = require_vectors(normals, "normals");
    if (n.ndim() != 2) throw py::value_error("normals must have shape (v, 3), got " + shape_of(n));
    mesh.normals.assign(vectors(n), vectors(n) + n.shape(0));
  }
  if (!colors.is_none()) {
    const Floats c = require_vectors(colors, "colors");
    if (c.ndim() != 2) throw py::value_error("colors must have shape (v, 3), got " + shape_of(c));
    mesh.colors.assign(vectors(c), vectors(c) + c.shape(0));
  }
  mesh.validate();
  return mesh;
}

void bind_obj(py::module_& module) {
  module.def(
      "_read_obj",
      [](const py::bytes& content, bool uvs, bool colors) -> py::object {
        const std::string_view text = content;
        glm::dvec3 offset;
        Mesh mesh;
        {
          const WithoutGil release;
          mesh = read_obj(text, {.uvs = uvs, .colors = colors}, nullptr, &offset);
        }
        return py::make_tuple(std::move(mesh), triple(offset));
      },
      py::arg("content"), py::arg("uvs") = false, py::arg("colors") = false,
      "Mesh, and what was subtracted from its places.");
  module.def(
      "_read_obj_materials",
      [](const py::bytes& content) -> py::object {
        const std::string_view text = content;
        ObjMaterials materials;
        glm::dvec3 offset;
        Mesh mesh;
        {
          const WithoutGil release;
          mesh = read_obj(text, {.uvs = true, .colors = true}, &materials, &offset);
        }
        const auto names = [](const std::vector<std::string>& all) {
          py::list out;
          for (const std::string& name : all)
            out.append(py::reinterpret_steal<py::str>(
                PyUnicode_DecodeUTF8(name.data(), py::ssize_t(name.size()), "replace")));
          return out;
        };
        return py::make_tuple(mesh, names(materials.libraries), names(materials.names),
                              py::array_t<int>(py::ssize_t(materials.of_triangles.size()),
                                               materials.of_triangles.data()),
                              triple(offset));
      },
      py::arg("content"),
      "Mesh with uvs and colours, libraries, names, the material of each triangle, and what was "
      "subtracted from the places.");
  module.def(
      "_offset_before_rounding",
      [](const std::array<double, 3>& lower, const std::array<double, 3>& upper) {
        return triple(
            offset_before_rounding({lower[0], lower[1], lower[2]}, {upper[0], upper[1], upper[2]}));
      },
      py::arg("lower"), py::arg("upper"),
      "What a reader subtracts from places in this box before it rounds them to float32.");
  module.def(
      "_polygon_triangles",
      [](const py::array_t<double, py::array::c_style | py::array::forcecast>& corners) {
        if (corners.ndim() != 2 || corners.shape(1) != 3)
          throw py::value_error("corners must have shape (n, 3), got " + shape_of(corners));
        std::vector<glm::dvec3> polygon;
        for (py::ssize_t i = 0; i < corners.shape(0); ++i)
          polygon.emplace_back(corners.at(i, 0), corners.at(i, 1), corners.at(i, 2));
        const std::vector<glm::ivec3> found = polygon_triangles(polygon);
        py::array_t<int> out({py::ssize_t(found.size()), py::ssize_t{3}});
        std::memcpy(out.mutable_data(), found.data(), found.size() * sizeof(glm::ivec3));
        return out;
      },
      py::arg("corners"));
}

void bind_bvh(py::module_& module) {
  py::class_<Bvh>(module, "Bvh", R"(Ray queries on a mesh. Triangles are two-sided.

mesh: Mesh; rays are in its frame, lengths in metres. Origins and directions are (..., 3) of any float dtype; t is in
units of the direction's length. Raises ValueError for other shapes, TypeError for integers.)")
      .def(py::init([](const Mesh& mesh) {
             const WithoutGil release;
             return Bvh(mesh);
           }),
           py::arg("mesh"))
      .def(
          "occluded",
          [](const Bvh& bvh, const py::object& origins, const py::object& directions, float t_min) {
            const Floats o = require_vectors(origins, "origins"),
                         d = require_vectors(directions, "directions");
            if (o.ndim() > 1 && shape_vector(o) != shape_vector(d))
              throw py::value_error(
                  "origins must be one point, or have the shape of directions; got " + shape_of(o) +
                  " and " + shape_of(d));
            std::vector<py::ssize_t> shape = shape_vector(d);
            shape.pop_back();
            py::array_t<bool> out(shape);
            bool* to = out.mutable_data();
            if (o.ndim() == 1) {
              const WithoutGil release;
              DirectionSet set(int(d.size() / 3));
              for (int i = 0; i < set.count; ++i) set.set(i, vectors(d)[i]);
              std::vector<std::uint8_t> hidden(std::size_t(set.count), 0);
              bvh.occluded(vectors(o)[0], set, t_min, hidden);
              std::copy(hidden.begin(), hidden.end(), to);
              return out;
            }
            {
              const WithoutGil release;
              parallel_for(int(o.size() / 3), 1024, [&](int begin, int end) {
                for (int i = begin; i < end; ++i)
                  to[i] = bvh.occluded({vectors(o)[i], vectors(d)[i], t_min});
              });
            }
            return out;
          },
          py::arg("origins"), py::arg("directions"), py::arg("t_min") = 0.0f,
          R"(Whether the rays (..., 3) hit the mesh beyond t_min; (...) bool.

origins may be a single point (3,) for all directions, which is several times faster.)")
      .def(
          "nearest",
          [](const Bvh& bvh, const py::object& origins, const py::object& directions, float t_min) {
            const Floats o = require_vectors(origins, "origins"),
                         d = require_vectors(directions, "directions");
            if (shape_vector(o) != shape_vector(d))
              throw py::value_error("origins and directions must have the same shape, got " +
                                    shape_of(o) + " and " + shape_of(d));
            std::vector<py::ssize_t> shape = shape_vector(o);
            shape.pop_back();
            py::array_t<int> triangle(shape);
            Floats t(shape);
            shape.push_back(2);
            Floats uv(shape);
            int* to = triangle.mutable_data();
            float *tt = t.mutable_data(), *tuv = uv.mutable_data();
            {
              const WithoutGil release;
              parallel_for(int(o.size() / 3), 1024, [&](int begin, int end) {
                for (int i = begin; i < end; ++i) {
                  const Bvh::Hit hit = bvh.nearest({vectors(o)[i], vectors(d)[i], t_min});
                  to[i] = hit.triangle,
                  tt[i] = hit.triangle < 0 ? std::numeric_limits<float>::infinity() : hit.t;
                  tuv[2 * i] = hit.u, tuv[2 * i + 1] = hit.v;
                }
              });
            }
            return py::make_tuple(triangle, t, uv);
          },
          py::arg("origins"), py::arg("directions"), py::arg("t_min") = 0.0f,
          "First hits of the rays (..., 3): triangle index (-1: none), t, and barycentric (u, v) "
          "of its second and third vertex.");
}

}  // namespace

void bind_mesh(py::module_& module) {
  bind_obj(module);
  py::class_<Mesh>(module, "Mesh", R"(Triangle mesh.

vertices: (v, 3) any float dtype, metres. triangles: (t, 3) integers, counter-clockwise from outside. uvs: (v, 2)
or None; (0, 0) is the lower left corner of a texture, which repeats. normals: (v, 3), or None to compute them. colors:
(v, 3) linear, 0 to 1, or None; they multiply Material.diffuse or the base colour of a pbr material. Raises ValueError
for wrong shapes, indices or colours out of range, or values that are not finite.)")
      .def(py::init(&make_mesh), py::arg("vertices"), py::arg("triangles"),
           py::arg("uvs") = py::none(), py::arg("normals") = py::none(),
           py::arg("colors") = py::none())
      .def_property_readonly(
          "vertices",
          [](const Mesh& m) {
            Floats out({py::ssize_t(m.vertices.size()), py::ssize_t{3}});
            std::copy(m.vertices.begin(), m.vertices.end(), vectors(out));
            return out;
          },
          "(v, 3) float32 metres, a copy.")
      .def_property_readonly(
          "triangles",
          [](const Mesh& m) {
            py::array_t<int> out({py::ssize_t(m.triangles.size()), py::ssize_t{3}});
            std::memcpy(out.mutable_data(), m.triangles.data(),
                        m.triangles.size() * sizeof(glm::ivec3));
            return out;
          },
          "(t, 3) int32, a copy.")
      .def_property_readonly(
          "uvs",
          [](const Mesh& m) -> py::object {
            if (m.uvs.empty()) return py::none();
            Floats out({py::ssize_t(m.uvs.size()), py::ssize_t{2}});
            std::memcpy(out.mutable_data(), m.uvs.data(), m.uvs.size() * sizeof(glm::vec2));
            return out;
          },
          "(v, 2) float32, a copy, or None.")
      .def_property_readonly(
          "colors",
          [](const Mesh& m) -> py::object {
            if (m.colors.empty()) return py::none();
            Floats out({py::ssize_t(m.colors.size()), py::ssize_t{3}});
            std::copy(m.colors.begin(), m.colors.end(), vectors(out));
            return out;
          },
          "(v, 3) float32, linear, a copy, or None.")
      .def_property_readonly(
          "normals",
          [](const Mesh& m) {
            const std::vector<glm::vec3> normals = vertex_normals(m);
            Floats out({py::ssize_t(normals.size()), py::ssize_t{3}});
            std::copy(normals.begin(), normals.end(), vectors(out));
            return out;
          },
          "(v, 3) float32 unit vertex normals: those given, else computed with weights by angle.")
      .def_property_readonly(
          "tangents",
          [](const Mesh& m) {
            const std::vector<glm::vec4> tangents = vertex_tangents(m, vertex_normals(m));
            Floats out({py::ssize_t(tangents.size()), py::ssize_t{4}});
            std::memcpy(out.mutable_data(), tangents.data(), tangents.size() * sizeof(glm::vec4));
            return out;
          },
          "(v, 4) float32: unit direction in which u grows, and the side (1 or -1) of normal x "
          "tangent on which v grows; without uvs, directions around the z axis.")
      .def_property_readonly("_given_normals",
                             [](const Mesh& m) -> py::object {
                               if (m.normals.empty()) return py::none();
                               Floats out({py::ssize_t(m.normals.size()), py::ssize_t{3}});
                               std::copy(m.normals.begin(), m.normals.end(), vectors(out));
                               return out;
                             })
      .def(py::self == py::self)
      .def("__repr__",
           [](const Mesh& m) {
             return "<fastibl.Mesh of " + std::to_string(m.vertices.size()) + " vertices, " +
                    std::to_string(m.triangles.size()) + " triangles>";
           })
      .def(py::pickle(
          [](const py::object& self) {
            return py::make_tuple(py::object(self.attr("vertices")),
                                  py::object(self.attr("triangles")), py::object(self.attr("uvs")),
                                  py::object(self.attr("_given_normals")),
                                  py::object(self.attr("colors")));
          },
          [](const py::tuple& t) { return py::type::of<Mesh>()(*t).cast<Mesh>(); }));
  bind_bvh(module);
}

}  // namespace fastibl::bindings
