#include "bindings/numpy.h"
#include "bindings/one_at_a_time.h"
#include "bindings/progress.h"
#include "bindings/spheres.h"
#include "fastibl/core/check.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/shading/ambient_occlusion.h"
#include "fastibl/shading/bake_visibility.h"
#include "fastibl/shading/glossy_shares.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl::bindings {
namespace {

struct SelfShadow {
  std::vector<glm::vec3> vertices, normals;
  VertexVisibility visibility;
  CellLight light;

  void update(const Lighting& lighting, const glm::mat3& marker_from_object) {
    check(lighting.radiance != nullptr, "self-shadow needs a lighting with its map");
    light.update(*lighting.radiance, glm::transpose(marker_from_object), visibility.size);
  }
  std::vector<glm::vec4> shares(const Lighting& lighting, const glm::mat3& marker_from_object) {
    update(lighting, marker_from_object);
    std::vector<glm::vec4> result(vertices.size(), glm::vec4(1));
    diffuse_shares(visibility, light, lighting.irradiance, normals, marker_from_object, result);
    return result;
  }
};

SelfShadow from_mesh(const Mesh& mesh, int size) {
  const WithoutGil release;
  return {
      mesh.vertices, vertex_normals(mesh), mesh_visibility(mesh, {size}, let_signals_through), {}};
}

SelfShadow from_spheres(const Mesh& mesh, const py::object& spheres, int size) {
  const SphereSet set = require_spheres(spheres);
  const WithoutGil release;
  mesh.validate();
  const std::vector<glm::vec3> normals = vertex_normals(mesh);
  return {mesh.vertices, normals, sphere_visibility(mesh.vertices, normals, set, {size}), {}};
}

glm::mat3 rotation_of(const py::object& marker_from_object) {
  return marker_from_object.is_none()
             ? glm::mat3(1)
             : glm::mat3(require_pose(marker_from_object, "marker_from_object").rotation);
}

Floats colours(const std::vector<glm::vec4>& values) {
  Floats out({py::ssize_t(values.size()), py::ssize_t{3}});
  for (std::size_t i = 0; i < values.size(); ++i) vectors(out)[i] = glm::vec3(values[i]);
  return out;
}

Floats glossy(SelfShadow& s, const Lighting& lighting, const py::object& eye, double exponent,
              const py::object& marker_from_object) {
  const Floats at = require_vectors(eye, "eye");
  if (at.ndim() != 1) throw py::value_error("eye must have shape (3,), got " + shape_of(at));
  if (!(exponent >= 0))
    throw py::value_error("the exponent must be at least 0, got " + std::to_string(exponent));
  std::vector<glm::vec4> shares(s.vertices.size());
  const glm::mat3 turn = rotation_of(marker_from_object);
  one_at_a_time(&s, [&] {
    s.update(lighting, turn);
    glossy_shares(s.visibility, s.light, {float(exponent)}, s.vertices, s.normals, *vectors(at),
                  shares);
  });
  Floats out(py::ssize_t(shares.size()));
  for (std::size_t i = 0; i < shares.size(); ++i) out.mutable_data()[i] = shares[i].w;
  return out;
}

// (v, k): whether at each vertex the cell of each direction is free and above the tangent plane.
py::array_t<bool> visible(const SelfShadow& s, const py::object& directions) {
  const Floats array = require_vectors(directions, "directions");
  if (array.ndim() != 2)
    throw py::value_error("directions must have shape (k, 3), got " + shape_of(array));
  const OctahedralGrid& grid = octahedral_grid(s.visibility.size);
  const py::ssize_t count = array.shape(0);
  py::array_t<bool> out({py::ssize_t(s.vertices.size()), count});
  for (py::ssize_t k = 0; k < count; ++k) {
    const glm::vec3 d = unit(vectors(array)[k]);
    const glm::vec2 p = float(grid.size()) * octahedral_point(d);
    const int cell =
        grid.cell(std::min(int(p.x), grid.size() - 1), std::min(int(p.y), grid.size() - 1));
    for (std::size_t i = 0; i < s.vertices.size(); ++i) {
      const std::span<const std::uint16_t> edges = s.visibility.edges_of(i);
      const bool blocked =
          (std::upper_bound(edges.begin(), edges.end(), cell) - edges.begin()) % 2 == 1;
      out.mutable_at(py::ssize_t(i), k) = !blocked && glm::dot(s.normals[i], d) > 0;
    }
  }
  return out;
}

}  // namespace

void bind_shading(py::module_& module) {
  module.def(
      "ambient_occlusion",
      [](const Mesh& mesh, int rays, const py::object& spheres) {
        const SphereSet set = spheres.is_none() ? SphereSet{} : require_spheres(spheres);
        std::vector<float> visibility;
        {
          const WithoutGil release;
          visibility = spheres.is_none() ? ambient_occlusion(mesh, {rays}, let_signals_through)
                                         : sphere_ambient_occlusion(mesh, set, {rays});
        }
        return py::array_t<float>(py::ssize_t(visibility.size()), visibility.data());
      },
      py::arg("mesh"), py::arg("rays") = 96, py::arg("spheres") = py::none(),
      R"(P_V of Eq. 8: cosine-weighted share of each vertex's hemisphere that is not hidden by the mesh itself.

rays: number per vertex. Returns (v,) float32 in [0, 1]: 1 on a convex mesh. The marker plane is not included; triangles
hide from both sides. spheres: (m, 4), x y z radius in the mesh's frame, which hide instead of the triangles, except
where a vertex is inside them. This is for objects that deform, and a hundred times faster; the RMS error is 0.02 for
spot, 0.05 for a figurine with thin parts, 0.4 for a laptop, because fitted spheres do not fill thin things. Raises
ValueError for rays < 1.)");

  py::class_<SelfShadow>(module, "SelfShadow",
                         R"(The light that an object keeps from itself, per vertex.

mesh: Mesh. size: cells of the sphere along an edge, 16, 32, 64 or 128 (64: 2.8 degrees, about 530 rays per vertex). The
directions that the mesh blocks are computed once; the light of any map is then summed over the free directions. The
marker plane is not included: below the horizon the map holds the table. Raises ValueError for another size.)")
      .def(py::init(&from_mesh), py::arg("mesh"), py::kw_only(), py::arg("size") = 64)
      .def_static(
          "from_spheres", &from_spheres, py::arg("mesh"), py::arg("spheres"), py::kw_only(),
          py::arg("size") = 16,
          R"(SelfShadow computed from spheres (m, 4) in the mesh's frame, for an object that deforms.

A sphere that contains a vertex does not hide it; spheres that are not finite or have no radius are ignored.
Raises ValueError for another shape or size.)")
      .def(
          "shares",
          [](SelfShadow& s, const Lighting& lighting, const py::object& marker_from_object) {
            const glm::mat3 turn = rotation_of(marker_from_object);
            return colours(one_at_a_time(&s, [&] { return s.shares(lighting, turn); }));
          },
          py::arg("lighting"), py::arg("marker_from_object") = py::none(),
          R"(Share of the irradiance that reaches each vertex, per colour channel: (v, 3) float32 in [0, 1].

1 where nothing is blocked, and where there is no light. lighting: Lighting of a map in the marker frame.
marker_from_object: Pose or (4, 4), where the mesh stands. Raises ValueError for what is not a pose.)")
      .def(
          "irradiance",
          [](SelfShadow& s, const Lighting& lighting, const py::object& marker_from_object) {
            const glm::mat3 turn = rotation_of(marker_from_object);
            return colours(one_at_a_time(&s, [&] {
              std::vector<glm::vec4> shares = s.shares(lighting, turn);
              for (std::size_t i = 0; i < shares.size(); ++i)
                shares[i] *= glm::vec4(evaluate(lighting.irradiance, turn * s.normals[i]), 1);
              return shares;
            }));
          },
          py::arg("lighting"), py::arg("marker_from_object") = py::none(),
          "Irradiance of each vertex with its self-shadow: (v, 3) float32. Arguments are those of "
          "`shares`.")
      .def(
          "glossy_shares", &glossy, py::arg("lighting"), py::arg("eye"), py::arg("exponent") = 64.0,
          py::arg("marker_from_object") = py::none(),
          R"(Share of the light in a glossy lobe of this half-vector exponent that reaches each vertex: (v,) float32.

eye: (3,) the place from which the object is seen, in the mesh's frame. The share is in [0, 1]: the sum of the lobe
times the map's radiance (mean of its channels) over the free directions, divided by the sum over all directions; 1
where the lobe meets no light, and where the vertex is seen from behind. Raises ValueError for a negative exponent.)")
      .def(
          "visible", &visible, py::arg("directions"),
          R"(Whether each vertex sees out along directions (k, 3), mesh frame, at the precision of a cell: (v, k) bool.

False below the vertex's tangent plane. Raises ValueError for another shape.)")
      .def_property_readonly(
          "size", [](const SelfShadow& s) { return s.visibility.size; },
          "Cells of the sphere along an edge.")
      .def_property_readonly(
          "nbytes",
          [](const SelfShadow& s) {
            return s.visibility.edges.size() * 2 + s.visibility.first.size() * 4;
          },
          "Memory of the directions, bytes.")
      .def("__repr__", [](const SelfShadow& s) {
        return "<fastibl.SelfShadow of " + std::to_string(s.vertices.size()) + " vertices, " +
               std::to_string(s.visibility.size) + " cells along an edge>";
      });
}

}  // namespace fastibl::bindings
