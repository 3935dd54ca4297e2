#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include "bindings/numpy.h"
#include "bindings/one_at_a_time.h"
#include "bindings/progress.h"
#include "fastibl/lighting/find_near_lights.h"
#include "fastibl/shadow/mesh_shadow_light.h"

namespace fastibl::bindings {
namespace {

template <typename T>
py::array_t<T> copied(const T* data, std::vector<py::ssize_t> shape) {
  return py::array_t<T>(std::move(shape), data);
}

constexpr std::size_t kArrays = 5;  // of a table

void append_arrays(const SparseCover::Table& table, py::list& out) {
  const auto size = [](const auto& v) { return py::ssize_t(v.size()); };
  out.append(copied(table.begin.data(), {size(table.begin)}));
  out.append(copied(table.source_of.data(), {size(table.source_of)}));
  out.append(copied(reinterpret_cast<const std::uint8_t*>(table.cover.data()),
                    {size(table.cover), py::ssize_t{16}}));
  out.append(copied(table.run_begin.data(), {size(table.run_begin)}));
  out.append(copied(reinterpret_cast<const std::uint16_t*>(table.runs.data()),
                    {size(table.runs), py::ssize_t{2}}));
}

// The rows of an array of T, each of which is a Row.
template <typename T, typename Row>
std::vector<Row> rows_of(const py::handle& object) {
  if (!py::isinstance<py::array_t<T>>(object))
    throw py::value_error("expected arrays of a table of uint32, uint16, uint8, uint32, uint16");
  const auto array = py::array_t<T, py::array::c_style>::ensure(object);
  constexpr std::size_t width = sizeof(Row) / sizeof(T);
  if (array.ndim() != (width > 1 ? 2 : 1) || (width > 1 && array.shape(1) != py::ssize_t(width)))
    throw py::value_error(
        "expected arrays of a table with shapes (b,), (n,), (n, 16), (b,), (r, 2), got " +
        shape_of(array));
  std::vector<Row> rows(std::size_t(array.size()) / width);
  if (!rows.empty()) std::memcpy(rows.data(), array.data(), rows.size() * sizeof(Row));
  return rows;
}

SparseCover table_of(int size, int sources, const py::list& arrays, std::size_t first) {
  return SparseCover(size, sources,
                     {rows_of<std::uint32_t, std::uint32_t>(arrays[first]),
                      rows_of<std::uint16_t, std::uint16_t>(arrays[first + 1]),
                      rows_of<std::uint8_t, SparseCover::Texels>(arrays[first + 2]),
                      rows_of<std::uint32_t, std::uint32_t>(arrays[first + 3]),
                      rows_of<std::uint16_t, SparseCover::Run>(arrays[first + 4])});
}

std::optional<MeshShadow> bake(const Mesh& mesh, const MeshShadowOptions& options,
                               const std::function<bool(float)>& progress) {
  const auto report = [&](float done) { return tell_python(progress, done); };
  const WithoutGil release;
  return MeshShadow::bake(mesh, options, report);
}

}  // namespace

void bind_mesh_shadow(py::module_& module) {
  py::class_<MeshShadowLight>(
      module, "MeshShadowLight",
      R"(What is kept from one light to the next: directions of dominant lights, and their shadows.)")
      .def(py::init([](int directions, float tolerance, int fine) {
             if (directions < 0 || directions > 4096)
               throw py::value_error("directions must be 0 to 4096, got " +
                                     std::to_string(directions));
             if (fine != 0 && (fine < 8 || fine > 4096))
               throw py::value_error("fine must be 0 or 8 to 4096, got " + std::to_string(fine));
             SkySplitOptions options;
             options.most_directions = directions, options.tolerance = tolerance;
             return MeshShadowLight(options, fine);
           }),
           py::arg("directions") = SkySplitOptions{}.most_directions,
           py::arg("tolerance") = SkySplitOptions{}.tolerance, py::arg("fine") = 0)
      .def_property_readonly("directions", &MeshShadowLight::directions,
                             "Number of directions for the last light.")
      .def_property_readonly("splits", &MeshShadowLight::splits,
                             "How often directions were chosen.");

  py::class_<MeshShadow, std::shared_ptr<MeshShadow>>(
      module, "BakedShadow", R"(How a rigid object hides the sky, see fastibl.MeshShadow.)")
      .def_static(
          "bake",
          [](const Mesh& mesh, int resolution, float extent, int rings, int samples,
             const std::function<bool(float)>& progress) -> py::object {
            std::optional<MeshShadow> made =
                bake(mesh, {resolution, extent, rings, samples}, progress);
            if (!made) return py::none();
            return py::cast(std::make_shared<MeshShadow>(std::move(*made)));
          },
          py::arg("mesh"), py::arg("resolution"), py::arg("extent"), py::arg("rings"),
          py::arg("samples"), py::arg("progress") = py::none(),
          R"(Returns None if `progress`, called with the part of the work that is done, returned False.)")
      .def_static(
          "from_tables",
          [](const Mesh& mesh, int resolution, float extent, int rings, int samples,
             const py::list& tables) {
            if (tables.size() != 2 * kArrays)
              throw py::value_error("expected ten arrays of two tables, got " +
                                    std::to_string(tables.size()));
            const int cells = SkyCells(rings).count();
            return std::make_shared<MeshShadow>(
                mesh, MeshShadowOptions{resolution, extent, rings, samples},
                MeshShadow::Tables{table_of(resolution, cells, tables, 0),
                                   table_of(resolution, cells, tables, kArrays)});
          },
          py::arg("mesh"), py::arg("resolution"), py::arg("extent"), py::arg("rings"),
          py::arg("samples"), py::arg("tables"),
          R"(Makes it from the `tables` of an earlier bake of the same mesh. Raises ValueError for tables that cannot be
such.)")
      .def_property_readonly(
          "tables",
          [](const MeshShadow& shadow) {
            py::list out;
            append_arrays(shadow.tables().inner.table(), out);
            append_arrays(shadow.tables().outer.table(), out);
            return out;
          },
          "Five arrays of each of two tables: where the entries of each block begin, their cells, "
          "their covers (n, 16), where the runs of each block begin, and the runs (r, 2) of cells "
          "that cover it wholly.")
      .def_property_readonly("bytes", &MeshShadow::bytes, "Memory of the tables.")
      .def_property_readonly(
          "extent", [](const MeshShadow& shadow) { return shadow.inner().extent; },
          "Half the map's edge in metres.")
      .def(
          "fits",
          [](const MeshShadow& shadow, const py::object& pose) {
            return shadow.motion(require_pose(pose, "marker_from_object")).has_value();
          },
          py::arg("marker_from_object"),
          "Whether the object still stands as it was baked: shifted on the plane and turned about "
          "z, no more.")
      .def(
          "cast",
          [](const MeshShadow& shadow, const CubeMap& cube, const py::object& pose,
             MeshShadowLight& light, const Environment* environment) {
            const Pose placed = pose.is_none() ? Pose{} : require_pose(pose, "marker_from_object");
            return one_at_a_time(&light, [&] {
              return light.cast(shadow, cube, placed,
                                environment ? find_near_lights(*environment) : NearLights{});
            });
          },
          py::arg("cube"), py::arg("marker_from_object"), py::arg("light"),
          py::arg("environment") = py::none(),
          "ShadowMap of the object under this light; environment: the Environment of the map, for "
          "its near lights.");
}

}  // namespace fastibl::bindings
