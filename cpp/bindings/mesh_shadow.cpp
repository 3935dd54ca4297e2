#include "fastibl/shadow/mesh_shadow.h"

#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include "bindings/numpy.h"

namespace fastibl::bindings {
namespace {

template <typename T>
py::array_t<T> copied(const T* data, std::vector<py::ssize_t> shape) {
  return py::array_t<T>(std::move(shape), data);
}

py::tuple table_arrays(const SparseCover& table) {
  const auto count = py::ssize_t(table.source_of().size());
  return py::make_tuple(copied(table.begin().data(), {py::ssize_t(table.begin().size())}),
                        copied(table.source_of().data(), {count}),
                        copied(reinterpret_cast<const std::uint8_t*>(table.cover().data()),
                               {count, py::ssize_t{16}}));
}

SparseCover table_of(int size, int sources, const py::tuple& arrays) {
  if (arrays.size() != 3) throw py::value_error("expected three arrays of a table");
  const auto begin = arrays[0].cast<py::array_t<std::uint32_t, py::array::c_style>>();
  const auto source_of = arrays[1].cast<py::array_t<std::uint16_t, py::array::c_style>>();
  const auto cover = arrays[2].cast<py::array_t<std::uint8_t, py::array::c_style>>();
  if (begin.ndim() != 1 || source_of.ndim() != 1 || cover.ndim() != 2 || cover.shape(1) != 16)
    throw py::value_error("expected arrays of a table with shapes (b,), (n,), (n, 16)");
  std::vector<SparseCover::Texels> texels(std::size_t(cover.shape(0)));
  if (!texels.empty()) std::memcpy(texels.data(), cover.data(), texels.size() * 16);
  return SparseCover(size, sources, {begin.data(), begin.data() + begin.size()},
                     {source_of.data(), source_of.data() + source_of.size()}, std::move(texels));
}

std::optional<MeshShadow> bake(const Mesh& mesh, const MeshShadowOptions& options,
                               const std::function<bool(float)>& progress) {
  const auto report = [&](float done) {
    const py::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    return progress ? progress(done) : true;
  };
  const py::gil_scoped_release release;
  return MeshShadow::bake(mesh, options, report);
}

}  // namespace

void bind_mesh_shadow(py::module_& module) {
  py::class_<MeshShadowLight>(
      module, "MeshShadowLight",
      R"(What lasts from one light to the next: directions of dominant lights, and their shadows.)")
      .def(py::init([](int directions, float tolerance) {
             if (directions < 0 || directions > 4096)
               throw py::value_error("directions must be 0 to 4096, got " +
                                     std::to_string(directions));
             SkySplitOptions options;
             options.most_directions = directions, options.tolerance = tolerance;
             return MeshShadowLight(options);
           }),
           py::arg("directions") = SkySplitOptions{}.most_directions,
           py::arg("tolerance") = SkySplitOptions{}.tolerance)
      .def_property_readonly("directions", &MeshShadowLight::directions,
                             "Number of directions of the last light.")
      .def_property_readonly("splits", &MeshShadowLight::splits,
                             "How often directions were chosen.");

  py::class_<MeshShadow, std::shared_ptr<MeshShadow>>(
      module, "BakedShadow", R"(What a rigid object hides of the sky, see fastibl.MeshShadow.)")
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
          R"(None if `progress`, called with the part that is done, returned False.)")
      .def_static(
          "from_table",
          [](const Mesh& mesh, int resolution, float extent, int rings, int samples,
             const py::tuple& table) {
            const int cells = SkyCells(rings).count();
            return std::make_shared<MeshShadow>(
                mesh, MeshShadowOptions{resolution, extent, rings, samples},
                table_of(resolution, cells, table));
          },
          py::arg("mesh"), py::arg("resolution"), py::arg("extent"), py::arg("rings"),
          py::arg("samples"), py::arg("table"),
          R"(From what `table` of an earlier bake of the same mesh was. Raises ValueError for what cannot be.)")
      .def_property_readonly(
          "table", [](const MeshShadow& shadow) { return table_arrays(shadow.table()); },
          "Three arrays: where the entries of each block begin, their cells, their covers (n, 16).")
      .def_property_readonly("bytes", &MeshShadow::bytes, "Memory of the table.")
      .def_property_readonly(
          "extent", [](const MeshShadow& shadow) { return shadow.grid().extent; },
          "Half the map's edge in metres.")
      .def(
          "fits",
          [](const MeshShadow& shadow, const py::object& pose) {
            return shadow.place(require_pose(pose, "marker_from_object")).has_value();
          },
          py::arg("marker_from_object"),
          "Whether the object still stands as it was baked: shifted on the plane and turned about "
          "z, no more.")
      .def(
          "cast",
          [](const MeshShadow& shadow, const CubeMap& cube, const py::object& pose,
             MeshShadowLight& light) {
            const Pose placed = pose.is_none() ? Pose{} : require_pose(pose, "marker_from_object");
            const py::gil_scoped_release release;
            return shadow.cast(cube, placed, light);
          },
          py::arg("cube"), py::arg("marker_from_object"), py::arg("light"),
          "ShadowMap of the object under this light.");
}

}  // namespace fastibl::bindings
