#include "fastibl/lighting/prefilter.h"

#include <pybind11/stl.h>

#include "bindings/numpy.h"

namespace fastibl::bindings {

void bind_prefilter(py::module_& module) {
  module.def(
      "_prefilter",
      [](const CubeMap& cube, const std::vector<std::pair<double, int>>& levels,
         const std::string& model, double error) {
        std::vector<PrefilterLevel> wanted;
        for (const auto& [parameter, size] : levels) wanted.push_back({parameter, size});
        PrefilterOptions options;
        options.model = lobe_model(model);
        options.error = error;
        const py::gil_scoped_release release;
        return prefilter(std::make_shared<const CubeMap>(cube), wanted, options);
      },
      py::arg("cube"), py::arg("levels"), py::arg("model"), py::arg("error"));
}

}  // namespace fastibl::bindings
