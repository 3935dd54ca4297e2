#include "bindings/numpy.h"
#include "bindings/spheres.h"
#include "fastibl/shading/ambient_occlusion.h"

namespace fastibl::bindings {

void bind_shading(py::module_& module) {
  module.def(
      "ambient_occlusion",
      [](const Mesh& mesh, int rays, const py::object& spheres) {
        const SphereSet set = spheres.is_none() ? SphereSet{} : require_spheres(spheres);
        std::vector<float> visibility;
        {
          const py::gil_scoped_release release;
          visibility = spheres.is_none() ? ambient_occlusion(mesh, {rays})
                                         : sphere_ambient_occlusion(mesh, set, {rays});
        }
        return py::array_t<float>(py::ssize_t(visibility.size()), visibility.data());
      },
      py::arg("mesh"), py::arg("rays") = 96, py::arg("spheres") = py::none(),
      R"(P_V of Eq. 8: cosine-weighted share of each vertex's hemisphere that the mesh itself leaves free.

rays: number a vertex. Returns (v,) float32 in [0, 1]: 1 on a convex mesh. The marker plane is not included;
triangles hide from both sides. spheres: (m, 4), x y z radius in the mesh's frame, which hide instead of the
triangles, except where a vertex is inside of them: for objects that deform, a hundred times faster, RMS error 0.02.
Raises ValueError for rays < 1.)");
}

}  // namespace fastibl::bindings
