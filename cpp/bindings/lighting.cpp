#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include "bindings/numpy.h"
#include "fastibl/core/clock.h"
#include "fastibl/core/parallel.h"
#include "fastibl/lighting/dominant_lights.h"
#include "fastibl/lighting/fit_irradiance.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/lighting/irradiance_sums.h"
#include "fastibl/lighting/prefilter.h"
#include "fastibl/scene/directional_albedo.h"
#include "fastibl/scene/glossy.h"

namespace fastibl::bindings {
namespace {

// Calls f(out, begin, end) for blocks of the vectors of `in` and returns (..., 3) float32.
template <typename F>
Floats map_blocks(const Floats& in, F&& f) {
  Floats out(shape_vector(in));
  glm::vec3* to = vectors(out);
  const WithoutGil release;
  parallel_for(int(in.size() / 3), 4096, [&](int begin, int end) { f(to, begin, end); });
  return out;
}

// The same, with f called for each vector.
template <typename F>
Floats map_vectors(const Floats& in, F&& f) {
  return map_blocks(in, [&](glm::vec3* to, int begin, int end) {
    for (int i = begin; i < end; ++i) to[i] = f(i);
  });
}

using Settings = std::map<std::string, int>;

// Makes no copy: Python's object lives as long as the returned pointer.
std::shared_ptr<const CubeMap> shared_cube(const py::object& object) {
  const CubeMap& cube = object.cast<const CubeMap&>();
  return {&cube, [keep = new py::object(object)](const CubeMap*) {
            const WithGil lock;
            delete keep;
          }};
}

void bind_light(py::module_& module) {
  py::class_<DominantLight>(module, "Light",
                            "A small bright part of a map: a disc of equal radiance.")
      .def_property_readonly(
          "direction", [](const DominantLight& l) { return triple(l.direction); },
          "Direction towards the light, unit length, marker frame.")
      .def_property_readonly(
          "angular_radius", [](const DominantLight& l) { return l.angular_radius; }, "Radians.")
      .def_property_readonly(
          "position",
          [](const DominantLight& l) -> py::object {
            return l.position ? py::object(triple(*l.position)) : py::none();
          },
          "Position of a near light in metres, marker frame; None for a light that is, or may be, "
          "distant.")
      .def_property_readonly(
          "irradiance", [](const DominantLight& l) { return triple(l.irradiance); },
          "Irradiance on a surface that faces the light, RGB.")
      .def_property_readonly(
          "flux", [](const DominantLight& l) { return triple(l.flux); },
          "RGB: radiance summed over its solid angle.")
      .def(py::self == py::self)
      .def(py::pickle(
          [](const DominantLight& l) {
            return py::make_tuple(triple(l.direction), l.angular_radius, triple(l.irradiance),
                                  triple(l.flux), triple(l.window), l.strength,
                                  l.position ? py::object(triple(*l.position)) : py::none());
          },
          [](const py::tuple& t) {
            const auto vector = [&](std::size_t k) { return require_triple(t[k], "light"); };
            DominantLight l;
            l.direction = vector(0), l.angular_radius = t[1].cast<float>();
            l.irradiance = vector(2), l.flux = vector(3), l.window = vector(4);
            l.strength = t[5].cast<float>();
            if (!t[6].is_none()) l.position = vector(6);
            return l;
          }))
      .def("__repr__", [](const DominantLight& l) {
        return "Light(direction=" + std::string(py::str(triple(l.direction))) +
               ", angular_radius=" + std::to_string(l.angular_radius) +
               ", irradiance=" + std::string(py::str(triple(l.irradiance))) + ")";
      });
}

void bind_making(py::class_<Lighting>& lighting_class) {
  lighting_class
      .def(py::init([](const py::object& cube, const std::string& diffuse,
                       const Settings& diffuse_given, const std::string& glossy,
                       const Settings& glossy_given, const Lighting* previous,
                       const Environment* environment) {
             LightingOptions options;
             options.diffuse = diffuse_method(diffuse);
             options.diffuse_settings =
                 settings_with<DiffuseSettings>(options.diffuse, diffuse_given);
             options.glossy = glossy_method(glossy);
             options.glossy_settings = settings_with<GlossySettings>(options.glossy, glossy_given);
             options.measure_error = false;
             options.environment = environment;
             const std::shared_ptr<const CubeMap> shared = shared_cube(cube);
             const WithoutGil release;
             return fit_lighting(shared, options, previous);
           }),
           py::arg("cube"), py::arg("diffuse"), py::arg("diffuse_settings"), py::arg("glossy"),
           py::arg("glossy_settings"), py::arg("previous") = nullptr,
           py::arg("environment") = nullptr)
      .def(py::init([](const Lighting& other) { return other; }), py::arg("other"));
}

void bind_look_ups(py::class_<Lighting>& lighting_class) {
  lighting_class
      .def(
          "irradiance",
          [](const Lighting& lighting, const py::object& normals) {
            const Floats in = require_vectors(normals, "normals");
            Floats out(shape_vector(in));
            glm::vec3* to = vectors(out);
            const WithoutGil release;
            parallel_for(int(in.size() / 3), 4096, [&](int begin, int end) {
              const std::span<glm::vec3> part(to + begin, std::size_t(end - begin));
              for (int i = begin; i < end; ++i) to[i] = unit(vectors(in)[i]);
              evaluate(lighting.irradiance, part, part);
            });
            return out;
          },
          py::arg("normals"), R"(Irradiance on surfaces facing `normals`.

normals: (..., 3) any float dtype, marker frame; normalised inside. Returns (..., 3) float32, never negative; pi for a
constant map of radiance 1 (six-face: 0.966 to 0.978 of pi). Raises ValueError for another shape, TypeError for integers
or objects.)")
      .def(
          "glossy",
          [](Lighting& lighting, const py::object& normals, const py::object& views,
             const py::object& exponent, const std::string& normalization_name) {
            ensure_chain(lighting);
            const py::module_ numpy = py::module_::import("numpy");
            const py::tuple pair = numpy.attr("broadcast_arrays")(
                require_vectors(normals, "normals"), require_vectors(views, "views"));
            const Floats n = Floats::ensure(pair[0]), v = Floats::ensure(pair[1]);
            std::vector<py::ssize_t> shape = shape_vector(n);
            shape.pop_back();
            const Floats s = broadcast_floats(exponent, "exponent", shape);
            for (py::ssize_t i = 0; i < s.size(); ++i)
              if (!(s.data()[i] >= 0))
                throw py::value_error("exponent must be at least 0, got " +
                                      std::to_string(s.data()[i]));
            Lighting with = lighting;
            with.normalization = normalization(normalization_name);
            const float* exponents = s.data();
            return map_blocks(n, [&](glm::vec3* to, int begin, int end) {
              for (int i = begin; i < end;) {
                const int first = i;
                const float own = exponents[i];  // usually the same for many in a row
                std::vector<glm::vec3> own_normals, own_views;
                for (; i < end && exponents[i] == own; ++i) {
                  own_normals.push_back(unit(vectors(n)[i]));
                  own_views.push_back(unit(vectors(v)[i]));
                }
                GlossyShading(with, own)(own_normals, own_views, {},
                                         {to + first, own_normals.size()});
              }
            });
          },
          py::arg("normals"), py::arg("views"), py::arg("exponent") = 64.0,
          py::arg("normalization") = "energy",
          R"(Radiance that a glossy lobe (Eq. 3, k_G = 1) reflects towards `views`.

normals, views: (..., 3) any float dtype, marker frame, broadcast; views run from the surface to the eye.
exponent: half-vector exponent s >= 0, broadcasts to (...); 0 gives irradiance / pi, infinity the mirror.
normalization: "energy" (the lobe's average), "paper" (times Eq. 3's directional albedo) or "exact" (the same with
the factor (s + 2)(s + 4) / (8 pi (2^(-s/2) + s)), which conserves energy for k_L + k_G <= 1). Returns (..., 3) float32. Raises ValueError for another shape, a negative or NaN exponent or another name, TypeError for integers.)");
}

void bind_products(py::class_<Lighting>& lighting_class) {
  lighting_class
      .def_property_readonly(
          "sh9",
          [](const Lighting& lighting) {
            const std::array<glm::dvec3, 9> sh = project_sh9(*lighting.radiance);
            Floats out({9, 3});
            for (int i = 0; i < 9; ++i)
              for (int c = 0; c < 3; ++c) out.mutable_at(i, c) = float(sh[std::size_t(i)][c]);
            return out;
          },
          R"((9, 3) float32: radiance in real, orthonormal spherical harmonics without Condon-Shortley phase, order
00, 1-1 (y), 10 (z), 11 (x), 2-2 (xy), 2-1 (yz), 20 (3z^2 - 1), 21 (xz), 22 (x^2 - y^2).)")
      .def(
          "irradiance_cube",
          [](const Lighting& lighting, int size, int source) {
            const WithoutGil release;
            return irradiance_cube(*lighting.radiance, size, source);
          },
          py::arg("size") = 16, py::arg("source") = kSumSize,
          R"(CubeMap whose texels hold the irradiance on surfaces facing them: pi for a constant map of radiance 1.

size: texels along a face. source: at most this many texels along a face of the MIP level over which the cosine is
summed; nMAE over seven real maps, median and worst: 0.09 and 0.39 % from 16, 0.014 and 0.07 % from 32. Raises
ValueError for sizes outside 1 to 256.)")
      .def_property_readonly(
          "lights", &dominant_lights,
          "The dominant lights of the map, at most 8: list of Light. Glossy methods with lights "
          "shade them separately; the rest of the map and the lights together hold every photon "
          "once.")
      .def_property_readonly(
          "_without_lights",
          [](const Lighting& lighting) {
            const WithoutGil release;
            return without_lights(lighting);
          },
          "CubeMap: the map without its lights.")
      .def_property_readonly(
          "plane_irradiance", [](const Lighting& l) { return triple(l.plane_irradiance); },
          "Irradiance E(z) on the marker plane, RGB, summed over the map.");
}

void bind_settings(py::class_<Lighting>& lighting_class) {
  lighting_class
      .def_property_readonly(
          "_diffuse", [](const Lighting& l) { return std::string(name(l.irradiance.method)); })
      .def_property_readonly("_diffuse_settings",
                             [](const Lighting& l) {
                               return settings_map(l.irradiance.method, l.irradiance.settings);
                             })
      .def_property_readonly(
          "_glossy_settings",
          [](const Lighting& l) { return settings_map(l.glossy, l.glossy_settings); })
      .def_property_readonly("_glossy",
                             [](const Lighting& l) { return std::string(name(l.glossy)); })
      .def_property_readonly("_irradiance_error", &irradiance_error);
}

void bind_light_times(py::module_& module) {
  module.def(
      "_seconds_to_fit",
      [](const CubeMap& cube, const Lighting& like, bool measure_error, int repetitions) {
        LightingOptions options;
        options.diffuse = like.irradiance.method;
        options.diffuse_settings = like.irradiance.settings;
        options.measure_error = measure_error;
        options.chain = false;
        const auto map = std::make_shared<const CubeMap>(cube);
        std::vector<double> seconds;
        for (int i = 0; i < repetitions; ++i) {
          const Stopwatch watch;
          fit_lighting(map, options);
          seconds.push_back(watch.seconds());
        }
        return seconds;
      },
      py::arg("cube"), py::arg("like"), py::arg("measure_error"), py::arg("repetitions"),
      "For benchmarks: times of fit_lighting in C++ by the diffuse method of another Lighting.");
  module.def(
      "_seconds_to_evaluate",
      [](const Lighting& lighting, const py::object& normals, int repetitions) {
        const Floats in = require_vectors(normals, "normals");
        const std::span<const glm::vec3> from(vectors(in), std::size_t(in.size() / 3));
        std::vector<glm::vec3> to(from.size());
        std::vector<double> seconds;
        for (int i = 0; i < repetitions; ++i) {
          const Stopwatch watch;
          evaluate(lighting.irradiance, from, to);
          seconds.push_back(watch.seconds());
        }
        return seconds;
      },
      py::arg("lighting"), py::arg("normals"), py::arg("repetitions"),
      "For benchmarks: times of the irradiance of unit normals in C++, one thread.");
  module.def(
      "_seconds_to_sum_cube",
      [](const CubeMap& cube, int size, int source, int repetitions) {
        std::vector<double> seconds;
        for (int i = 0; i < repetitions; ++i) {
          const Stopwatch watch;
          irradiance_cube(fold(cube, source), size);
          seconds.push_back(watch.seconds());
        }
        return seconds;
      },
      py::arg("cube"), py::arg("size"), py::arg("source"), py::arg("repetitions"),
      "For benchmarks: times of building an irradiance cube in C++.");
}

}  // namespace

void bind_lighting(py::module_& module) {
  bind_light(module);
  py::class_<Lighting> lighting_class(module, "_Lighting");
  bind_making(lighting_class);
  bind_look_ups(lighting_class);
  bind_products(lighting_class);
  bind_settings(lighting_class);
  bind_light_times(module);
  module.def(
      "directional_albedo",
      [](const py::object& cos_view, float exponent) {
        const Floats in = require_numbers(cos_view, "cos_view");
        if (!(exponent >= 0))
          throw py::value_error("exponent must be at least 0, got " + std::to_string(exponent));
        Floats out(shape_vector(in));
        for (py::ssize_t i = 0; i < in.size(); ++i)
          out.mutable_data()[i] = directional_albedo(in.data()[i], exponent);
        return out;
      },
      py::arg("cos_view"), py::arg("exponent"),
      R"(Directional albedo rho(theta_v, s) of Eq. 3 (Croubois et al. 2014), from the library's table.

cos_view: cos theta_v of any shape, any float dtype, clamped to [0, 1]; NaN counts as 0. exponent: s >= 0, may be
infinite. Returns float32 of that shape, within 0.002.
Raises ValueError for a negative or NaN exponent, TypeError for integers.)");
}

}  // namespace fastibl::bindings
