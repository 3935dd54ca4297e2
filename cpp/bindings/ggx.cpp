#include "fastibl/scene/ggx.h"

#include <pybind11/stl.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "bindings/numpy.h"
#include "fastibl/core/parallel.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/scene/sampled_lobe.h"

namespace fastibl::bindings {
namespace {

void check_range(const Floats& values, const char* name, float low, float high) {
  for (py::ssize_t i = 0; i < values.size(); ++i)
    if (!(values.data()[i] >= low && values.data()[i] <= high))
      throw py::value_error(std::string(name) + " must be " +
                            py::str(py::float_(low)).cast<std::string>() + " to " +
                            py::str(py::float_(high)).cast<std::string>() + ", got " +
                            std::to_string(values.data()[i]));
}

// GGX's alpha for each element of `shape`, taken from the pairs in `alpha` if they are given.
std::vector<glm::vec2> alphas(const py::object& roughness, const py::object& anisotropy,
                              const py::object& alpha, std::vector<py::ssize_t> shape) {
  std::vector<glm::vec2> out;
  if (!alpha.is_none()) {
    shape.push_back(2);
    const Floats pairs = broadcast_floats(alpha, "alpha", shape);
    check_range(pairs, "alpha", 0, 1);
    for (py::ssize_t i = 0; i < pairs.size(); i += 2)
      out.push_back(glm::max(glm::vec2(pairs.data()[i], pairs.data()[i + 1]), kSmallestAlpha));
    return out;
  }
  const Floats r = broadcast_floats(roughness, "roughness", shape),
               a = broadcast_floats(anisotropy, "anisotropy", shape);
  check_range(r, "roughness", 0, 1), check_range(a, "anisotropy", 0, 1);
  for (py::ssize_t i = 0; i < r.size(); ++i) out.push_back(ggx_alpha(r.data()[i], a.data()[i]));
  return out;
}

Floats ggx(Lighting& lighting, const py::object& normals, const py::object& views,
           const py::object& roughness, const py::object& anisotropy, const py::object& tangents,
           const py::object& alpha, const std::string& normalization, const std::string& method,
           const std::optional<int>& taps) {
  ensure_chain(lighting);
  const bool single = normalization == "single";
  if (!single && normalization != "energy")
    throw py::value_error("normalization must be \"energy\" or \"single\", got \"" + normalization +
                          "\"");
  GgxOptions options{ggx_method(method)};
  const bool sampled = options.method == GgxMethod::sampled;
  const int most = sampled ? kMaxSampledTaps : kMostGgxTaps;
  options.taps = taps.value_or(sampled ? 64 : kGgxTaps);
  if (options.taps < 1 || options.taps > most)
    throw py::value_error("taps of " + method + " must be 1 to " + std::to_string(most) + ", got " +
                          std::to_string(options.taps));
  const py::module_ numpy = py::module_::import("numpy");
  const Floats given = tangents.is_none() ? Floats(std::vector<py::ssize_t>{3})
                                          : require_vectors(tangents, "tangents");
  Floats none = given;
  if (tangents.is_none()) std::fill_n(none.mutable_data(), 3, 0.0f);
  const py::tuple all = numpy.attr("broadcast_arrays")(require_vectors(normals, "normals"),
                                                       require_vectors(views, "views"), none);
  const Floats n = Floats::ensure(all[0]), v = Floats::ensure(all[1]), t = Floats::ensure(all[2]);
  std::vector<py::ssize_t> shape = shape_vector(n);
  shape.pop_back();
  const std::vector<glm::vec2> pairs = alphas(roughness, anisotropy, alpha, shape);
  Floats out(shape_vector(n));
  glm::vec3* to = vectors(out);
  {
    const WithoutGil release;
    const GgxShading shading(lighting);
    const bool round = options.method == GgxMethod::taps && options.taps == kGgxTaps &&
                       std::ranges::all_of(pairs, [](glm::vec2 a) { return a.x == a.y; });
    parallel_for(int(pairs.size()), 512, [&](int begin, int end) {
      std::vector<glm::vec3> unit_normals, unit_views;
      std::vector<float> round_alphas;
      for (int i = begin; i < end; ++i) {
        unit_normals.push_back(unit(vectors(n)[i])), unit_views.push_back(unit(vectors(v)[i]));
        round_alphas.push_back(pairs[std::size_t(i)].x);
      }
      std::vector<GgxLight> light(unit_normals.size());
      if (round) shading(unit_normals, unit_views, round_alphas, {}, light);
      for (std::size_t k = 0; k < light.size(); ++k) {
        const std::size_t i = std::size_t(begin) + k;
        const glm::vec3 view = unit_views[k];
        SurfaceFrame frame{};
        if (!round || single) frame = frame_around(unit_normals[k], vectors(t)[i]);
        if (!round) light[k] = shading(frame, view, pairs[i], options);
        to[i] = light[k].mean();
        if (!single) continue;
        const glm::dvec3 local(glm::dot(view, frame.tangent), glm::dot(view, frame.bitangent),
                               glm::dot(view, frame.normal));
        const glm::dvec2 albedo = integrate_ggx_albedo(local, glm::dvec2(pairs[i]));
        to[i] *= float(albedo.x + albedo.y);
      }
    });
  }
  return out;
}

}  // namespace

void bind_ggx(py::module_& module) {
  py::class_<Lighting>(module.attr("_Lighting"))
      .def("ggx", &ggx, py::arg("normals"), py::arg("views"), py::arg("roughness") = 0.4,
           py::arg("anisotropy") = 0.0, py::arg("tangents") = py::none(), py::kw_only(),
           py::arg("alpha") = py::none(), py::arg("normalization") = "energy",
           py::arg("method") = "taps", py::arg("taps") = py::none(),
           R"(Radiance that a GGX surface with Fresnel term 1 reflects towards `views`.

normals, views, tangents: (..., 3) any float dtype, marker frame, broadcast; views run from the surface to the eye.
tangents: the direction of alpha_x, made perpendicular to the normals; where it is 0 or along the normal, any direction.
roughness, anisotropy: in [0, 1], broadcast to (...), glTF's mapping (KHR_materials_anisotropy): alpha_y = roughness^2,
alpha_x = alpha_y + (1 - alpha_y) anisotropy^2, both at least 0.02.
alpha: (..., 2), alpha_x and alpha_y themselves, instead of roughness and anisotropy.
normalization: "energy" (the lobe's average: multiple scattering is compensated, so that a constant map of radiance 1
gives 1) or "single" (this times the directional albedo of single scattering).
method: "taps" (parts of the lobe along its longest axis), "gradient" (the paper's suggestion, texture gradients) or
"sampled" (filtered importance sampling of the map's MIP levels, which tends to the truth).
taps: number of look-ups, 1 to 16, 8 by default; for "sampled" 1 to 65536, 64 by default.
Returns (..., 3) float32.
Raises ValueError for another shape, a value out of range or another name, TypeError for integers.)");
  module.def(
      "ggx_albedo",
      [](const py::object& views, const py::object& roughness, const py::object& anisotropy,
         const py::object& alpha) {
        const Floats v = require_vectors(views, "views");
        std::vector<py::ssize_t> shape = shape_vector(v);
        shape.pop_back();
        const std::vector<glm::vec2> pairs = alphas(roughness, anisotropy, alpha, shape);
        shape.push_back(2);
        Floats out(shape);
        float* to = out.mutable_data();
        const WithoutGil release;
        parallel_for(int(pairs.size()), 16, [&](int begin, int end) {
          for (int i = begin; i < end; ++i) {
            const glm::dvec2 value = integrate_ggx_albedo(glm::dvec3(unit(vectors(v)[i])),
                                                          glm::dvec2(pairs[std::size_t(i)]));
            to[2 * i] = float(value.x), to[2 * i + 1] = float(value.y);
          }
        });
        return out;
      },
      py::arg("views"), py::arg("roughness") = 0.4, py::arg("anisotropy") = 0.0, py::kw_only(),
      py::arg("alpha") = py::none(),
      R"(Directional albedo of single-scattering GGX, (..., 2) float32: the split sum's f0 term and the rest.

views: (..., 3) in the surface's frame (tangent, bitangent, normal). With Schlick's Fresnel term the albedo is f0 a + b,
with Fresnel term 1 it is a + b. roughness, anisotropy, alpha: as in Lighting.ggx. By quadrature, within 1.2e-4, and 1e-3
where the two alphas differ. Raises
ValueError for another shape or values out of range.)");
  module.def(
      "dfg_table",
      [](int size) {
        Image<float> table;
        {
          const WithoutGil release;
          table = dfg_table(size);
        }
        return image_array(table);
      },
      py::arg("size") = 64,
      R"(The split sum's table (DFG, Karis 2013) for a renderer of one's own: (size, size, 2) float32, a and b of ggx_albedo.

Column i is the cosine of the view to the normal, (i + 0.5) / size; row j is the roughness, (j + 0.5) / size, whose
square is alpha, at least 0.02: a texture to be looked up at (cosine, roughness), clamped to its edge. The reflectance
of a prefiltered map is f0 a + b. Raises ValueError for a size outside 1 to 1024.)");
}

}  // namespace fastibl::bindings
