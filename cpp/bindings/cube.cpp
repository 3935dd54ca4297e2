#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <string>
#include <vector>

#include "bindings/numpy.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/equirect.h"

namespace fastibl::bindings {
namespace {

CubeMap cube_from_array(const py::object& object) {
  const Floats array = require_floats<float>(object, "faces");
  if (array.ndim() != 4 || array.shape(0) != 6 || array.shape(3) != 3 ||
      array.shape(1) != array.shape(2) || array.shape(1) < 1)
    throw py::value_error("faces must have shape (6, n, n, 3) with n at least 1, got " +
                          shape_of(array));
  return CubeMap(int(array.shape(1)), {vectors(array), std::size_t(array.size() / 3)});
}

// Zero-copy view of one level; it keeps `owner` alive.
py::array level_view(const CubeMap& cube, int k, const py::object& owner) {
  const CubeLevel& level = cube.level(k);
  const py::ssize_t n = level.size(), t = sizeof(glm::vec3);
  py::array view(py::dtype::of<float>(), {py::ssize_t{6}, n, n, py::ssize_t{3}},
                 {level.face_stride() * t, level.row_stride() * t, t, py::ssize_t(sizeof(float))},
                 &level.face(0)->x, owner);
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

}  // namespace

void bind_cube(py::module_& module) {
  py::class_<CubeMap>(module, "CubeMap", R"(Linear radiance over the sphere, with its MIP chain.

faces: (6, n, n, 3), any float dtype, in the order +x -x +y -y +z -z with OpenGL's orientation; a direction in the
marker frame is the OpenGL cube coordinate. NaN and negative values become 0, values above 1e9 (and infinity) become
1e9; `cleaned` counts them. Raises ValueError for another shape, TypeError for integers.)")
      .def(py::init(&cube_from_array), py::arg("faces"))
      .def_property_readonly(
          "faces",
          [](const py::object& self) { return level_view(self.cast<const CubeMap&>(), 0, self); },
          "(6, n, n, 3) float32: a read-only view, no copy.")
      .def(
          "level",
          [](const py::object& self, int k) {
            const CubeMap& cube = self.cast<const CubeMap&>();
            if (k < 0 || k >= cube.level_count())
              throw py::index_error("level must be 0 to " + std::to_string(cube.level_count() - 1) +
                                    ", got " + std::to_string(k));
            return level_view(cube, k, self);
          },
          py::arg("k"),
          "MIP level k as a read-only view (6, n >> k, n >> k, 3) float32: solid-angle means of "
          "level 0. Raises IndexError beyond the chain.")
      .def_property_readonly("size", &CubeMap::size, "Face edge n in texels.")
      .def_property_readonly("level_count", &CubeMap::level_count,
                             "Number of MIP levels, including the faces themselves.")
      .def_property_readonly(
          "tile_versions",
          [](const CubeMap& cube) {
            const int t = cube.tiles().per_edge();
            py::array_t<std::uint64_t> out({6, t, t});
            const auto versions = cube.tile_versions();
            std::copy(versions.begin(), versions.end(), out.mutable_data());
            return out;
          },
          R"((6, t, t) uint64, t = min(size, 16): where two maps of one size have the same number, they have the same
texels in that part of a face. With them, what is made from a map can be renewed only where the map changed.)")
      .def(
          "_rebuild", [](CubeMap& cube) { cube.update(); },
          "Makes all levels anew from the faces: the same map, for timing.")
      .def_property_readonly(
          "cleaned",
          [](const CubeMap& cube) {
            const CleaningStatistics& s = cube.cleaned();
            return py::dict(py::arg("nan") = s.nan, py::arg("negative") = s.negative,
                            py::arg("capped") = s.capped);
          },
          "How many values were changed by cleaning on entry: nan, negative, capped.")
      .def(
          "_count_cleaned_of",
          [](CubeMap& cube, const CubeMap& made_of) { cube.set_cleaned(made_of.cleaned()); },
          py::arg("made_of"))
      .def(
          "mean", [](const CubeMap& cube) { return triple(cube.mean()); },
          "Solid-angle mean radiance of the sphere, RGB.")
      .def(
          "sample",
          [](const CubeMap& cube, const py::object& directions, const py::object& level) {
            const Floats in = require_vectors(directions, "directions");
            const py::ssize_t count = in.size() / 3;
            py::array_t<float, py::array::c_style | py::array::forcecast> levels;
            float single = 0;
            const bool scalar = is_number(level);
            if (scalar) {
              single = py::float_(level).cast<float>();
            } else {
              std::vector<py::ssize_t> shape = shape_vector(in);
              shape.pop_back();
              levels = broadcast_floats(level, "level", shape);
            }
            Floats out(shape_vector(in));
            const glm::vec3* d = vectors(in);
            glm::vec3* to = vectors(out);
            const float* per = scalar ? nullptr : levels.data();
            {
              const WithoutGil release;
              parallel_for(int(count), 4096, [&](int begin, int end) {
                for (int i = begin; i < end; ++i) to[i] = cube.sample(d[i], per ? per[i] : single);
              });
            }
            return out;
          },
          py::arg("directions"), py::arg("level") = 0.0,
          R"(Seamless trilinear look-up.

directions: (..., 3) any float dtype, marker frame, any length. level: MIP level, a number or broadcastable to
(...), clamped to the chain. Returns (..., 3) float32. Raises ValueError for another shape, TypeError for integers.)")
      .def(py::self == py::self)
      .def("__repr__",
           [](const CubeMap& cube) {
             return "<fastibl.CubeMap 6 x " + std::to_string(cube.size()) + " x " +
                    std::to_string(cube.size()) + ">";
           })
      .def("__copy__", [](const CubeMap& cube) { return cube; })
      .def(
          "__deepcopy__", [](const CubeMap& cube, const py::dict&) { return cube; },
          py::arg("memo"))
      .def(py::pickle(
          [](const py::object& self) {
            const CubeMap& cube = self.cast<const CubeMap&>();
            const CleaningStatistics& s = cube.cleaned();
            return py::make_tuple(
                py::module_::import("numpy").attr("array")(level_view(cube, 0, self)), s.nan,
                s.negative, s.capped);
          },
          [](const py::tuple& t) {
            CubeMap cube = cube_from_array(t[0]);
            if (t.size() == 4)
              cube.set_cleaned({t[1].cast<int>(), t[2].cast<int>(), t[3].cast<int>()});
            return cube;
          }));

  module.def(
      "cubemap_from_equirect",
      [](const py::object& object, int size, const std::string& filter) {
        if (filter != "area" && filter != "point")
          throw py::value_error("filter must be \"area\" or \"point\", got \"" + filter + "\"");
        const Floats array = require_floats<float>(object, "image");
        if (array.ndim() != 3 || array.shape(2) != 3 || array.shape(0) < 1 || array.shape(1) < 1)
          throw py::value_error("image must have shape (height, width, 3), got " + shape_of(array));
        const ImageView<const float> view{array.data(), int(array.shape(1)), int(array.shape(0)), 3,
                                          3 * array.shape(1)};
        const WithoutGil release;
        return cubemap_from_equirect(
            view, size, filter == "area" ? EquirectFilter::area : EquirectFilter::point);
      },
      py::arg("image"), py::arg("size") = 128, py::arg("filter") = "area",
      R"(Cube map of an equirectangular picture.

filter: "area" is exact and keeps the energy of each channel; "point" makes one bilinear look-up per texel, which is
faster, for pictures about as fine as the map.

image: (height, width, 3) any float dtype, linear radiance; z is at the top, the centre looks along +y, x grows to the
right. size: face edge in texels. Raises ValueError for another shape or filter, TypeError for integers.)");
  module.def(
      "equirect_from_cubemap",
      [](const CubeMap& cube, int height) {
        Image<float> image;
        {
          const WithoutGil release;
          image = equirect_from_cubemap(cube, height);
        }
        return image_array(image);
      },
      py::arg("cube"), py::arg("height") = 512,
      "Equirectangular picture (height, 2 height, 3) float32 of a cube map, area-exact: z at the "
      "top, +y in the middle. Raises ValueError for a height below 1.");
  module.def(
      "texel_solid_angles",
      [](int size) {
        if (size < 1) throw py::value_error("size must be at least 1, got " + std::to_string(size));
        const std::vector<double> angles = texel_solid_angles(size);
        Doubles out({size, size});
        std::copy(angles.begin(), angles.end(), out.mutable_data());
        return out;
      },
      py::arg("size"),
      "Exact solid angles (size, size) float64 of the texels of one face; six faces sum to 4 pi. "
      "Raises ValueError for a size below 1.");
  module.def(
      "texel_directions",
      [](int size) {
        if (size < 1) throw py::value_error("size must be at least 1, got " + std::to_string(size));
        Floats out({6, size, size, 3});
        glm::vec3* to = vectors(out);
        for (int f = 0; f < 6; ++f)
          for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) *to++ = glm::normalize(texel_direction(f, x, y, size));
        return out;
      },
      py::arg("size"),
      "Unit directions (6, size, size, 3) float32 of the texel centres, marker frame. Raises "
      "ValueError for a size below 1.");
}

}  // namespace fastibl::bindings
