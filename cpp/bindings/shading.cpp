#include "bindings/numpy.h"
#include "fastibl/shading/ambient_occlusion.h"

namespace fastibl::bindings {

void bind_shading(py::module_& module) {
  module.def(
      "ambient_occlusion",
      [](const Mesh& mesh, int rays) {
        std::vector<float> visibility;
        {
          const py::gil_scoped_release release;
          visibility = ambient_occlusion(mesh, {rays});
        }
        return py::array_t<float>(py::ssize_t(visibility.size()), visibility.data());
      },
      py::arg("mesh"), py::arg("rays") = 64,
      R"(P_V of Eq. 8: cosine-weighted share of each vertex's hemisphere that the mesh itself leaves free.

rays: number a vertex. Returns (v,) float32 in [0, 1]: 1 on a convex mesh. The marker plane is not included;
triangles hide from both sides. Raises ValueError for rays < 1.)");
}

}  // namespace fastibl::bindings
