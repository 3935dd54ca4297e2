#include "fastibl/lighting/prefilter.h"

#include <pybind11/stl.h>

#include <tuple>

#include "bindings/numpy.h"
#include "fastibl/scene/lighting.h"

namespace fastibl::bindings {

void bind_prefilter(py::module_& module) {
  module.def(
      "_prefilter",
      [](const Lighting& lighting, const std::vector<std::tuple<double, int, bool>>& levels,
         const std::string& model, double error) {
        std::vector<PrefilterLevel> wanted;
        for (const auto& [parameter, size, is_wanted] : levels)
          wanted.push_back({parameter, size, is_wanted});
        PrefilterOptions options;
        options.model = lobe_model(model);
        options.error = error;
        const WithoutGil release;
        return prefilter(lighting.radiance, wanted, options);
      },
      py::arg("lighting"), py::arg("levels"), py::arg("model"), py::arg("error"));
  module.def(
      "_level_parameters",
      [](const std::string& mapping, int count) {
        return level_parameters(level_mapping(mapping), count);
      },
      py::arg("mapping"), py::arg("count"));
}

}  // namespace fastibl::bindings
