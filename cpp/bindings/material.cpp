#include "fastibl/scene/material.h"

#include <cmath>

#include "bindings/numpy.h"

namespace fastibl::bindings {
namespace {

enum class Coding { linear, srgb, normal };  // what 8 bits, or the range 0 to 1, mean

float decoded(float value, Coding coding) {
  if (coding == Coding::srgb) return Response::srgb().decode(value);
  return coding == Coding::normal ? 2 * value - 1 : value;
}

// array: a picture (h, w, 3), or (h, w) or (h, w, 1) for one channel; uint8, or float from 0 to 1.
std::shared_ptr<const SurfaceTexture> texture(const py::array& array, const char* name,
                                              int channels, Coding coding,
                                              const SurfaceTexture::Wraps& wraps) {
  const bool fits = channels == 3 ? array.ndim() == 3 && array.shape(2) == 3
                                  : array.ndim() == 2 || (array.ndim() == 3 && array.shape(2) == 1);
  if (!fits || array.shape(0) < 1 || array.shape(1) < 1)
    throw py::value_error(std::string(name) + " must be " +
                          (channels == 3 ? "three numbers or a texture (height, width, 3)"
                                         : "a number or a texture (height, width)") +
                          ", got shape " + shape_of(array));
  const bool bytes = array.dtype().kind() == 'u' && array.dtype().itemsize() == 1;
  if (!bytes && array.dtype().kind() != 'f')
    throw py::type_error(std::string(name) + " must be a texture of uint8 or floats, got dtype " +
                         std::string(py::str(array.dtype())));
  const auto values = py::array_t<float, py::array::c_style | py::array::forcecast>::ensure(array);
  Image<float> image(int(array.shape(1)), int(array.shape(0)), channels);
  float table[256];
  for (int i = 0; i < 256; ++i) table[i] = decoded(float(i) / 255, coding);
  for (std::size_t i = 0; i < image.data.size(); ++i) {
    const float value = values.data()[i];
    image.data[i] = bytes                      ? table[int(value)]
                    : coding == Coding::normal ? decoded(value, coding)
                                               : value;
  }
  return std::make_shared<const SurfaceTexture>(std::move(image), wraps);
}

bool is_texture(const py::object& value) {
  return py::isinstance<py::array>(value) && py::reinterpret_borrow<py::array>(value).ndim() >= 2;
}

// wrap: the name of one mode, or of one along u and another along v.
SurfaceTexture::Wraps wraps_of(const py::object& wrap) {
  const auto one = [](const py::handle& mode) {
    if (!py::isinstance<py::str>(mode))
      throw py::type_error("wrap must be repeat, clamp or mirror, or two of them, got " +
                           type_name(mode));
    return wrap_mode(mode.cast<std::string>());
  };
  if (!py::isinstance<py::tuple>(wrap) && !py::isinstance<py::list>(wrap))
    return {one(wrap), one(wrap)};
  const py::sequence both = wrap;
  if (both.size() != 2)
    throw py::value_error("wrap must be one mode or two, along u and v, got " +
                          std::to_string(both.size()));
  return {one(both[0]), one(both[1])};
}

// The wrap modes of the textures, which share them, as two names.
py::object wrap_of(const PbrMaterial& m) {
  for (const auto* map :
       {&m.base_color_map, &m.metallic_map, &m.roughness_map, &m.emission_map, &m.normal_map})
    if (*map)
      return py::make_tuple(std::string(name((*map)->wraps()[0])),
                            std::string(name((*map)->wraps()[1])));
  return py::make_tuple("repeat", "repeat");
}

// Sets either a constant or a texture; with a texture the constant becomes 1.
void set_colour(const py::object& value, const char* name, glm::vec3& constant,
                std::shared_ptr<const SurfaceTexture>& map, const SurfaceTexture::Wraps& wraps) {
  if (is_texture(value)) {
    map = texture(value, name, 3, Coding::srgb, wraps);
    constant = glm::vec3(1);
  } else {
    constant = require_triple(value, name);
  }
}

void set_number(const py::object& value, const char* name, float& constant,
                std::shared_ptr<const SurfaceTexture>& map, const SurfaceTexture::Wraps& wraps) {
  if (is_texture(value)) {
    map = texture(value, name, 1, Coding::linear, wraps);
    constant = 1;
    return;
  }
  const bool number = PyFloat_Check(value.ptr()) ||
                      (PyLong_Check(value.ptr()) && !PyBool_Check(value.ptr())) ||
                      py::hasattr(value, "__float__");
  if (!number || py::isinstance<py::str>(value))
    throw py::type_error(std::string(name) +
                         " must be a number or a texture (height, width), got " + type_name(value));
  constant = py::float_(value).cast<float>();
}

py::object array_of(const SurfaceTexture& map, Coding coding = Coding::linear) {
  Image<float> image = map.level(0);
  if (coding == Coding::normal)
    for (float& v : image.data) v = 0.5f * v + 0.5f;
  return image_array(image);
}

py::object colour_or_array(const glm::vec3& constant,
                           const std::shared_ptr<const SurfaceTexture>& map) {
  return map ? array_of(*map) : py::object(triple(constant));
}
py::object number_or_array(float constant, const std::shared_ptr<const SurfaceTexture>& map) {
  return map ? array_of(*map) : py::object(py::float_(constant));
}

Material pbr(const py::object& base_color, const py::object& metallic, const py::object& roughness,
             const py::object& normal, const py::object& emission, float anisotropy,
             float anisotropy_rotation, float normal_scale, const py::object& wrap, float ior,
             float specular, const py::object& specular_color) {
  PbrMaterial m;
  const SurfaceTexture::Wraps wraps = wraps_of(wrap);
  set_colour(base_color, "base_color", m.base_color, m.base_color_map, wraps);
  set_number(metallic, "metallic", m.metallic, m.metallic_map, wraps);
  set_number(roughness, "roughness", m.roughness, m.roughness_map, wraps);
  set_colour(emission, "emission", m.emission, m.emission_map, wraps);
  if (!normal.is_none()) {
    if (!py::isinstance<py::array>(normal))
      throw py::type_error("normal must be a texture (height, width, 3) or None, got " +
                           type_name(normal));
    m.normal_map = texture(normal, "normal", 3, Coding::normal, wraps);
  }
  m.anisotropy = anisotropy, m.anisotropy_rotation = anisotropy_rotation;
  m.normal_scale = normal_scale;
  m.ior = ior, m.specular = specular;
  m.specular_color = require_triple(specular_color, "specular_color");
  const WithoutGil release;
  return Material::make_pbr(m);
}

// Getters for properties that only one of the two models has: None in the other.
template <typename F>
auto of_pbr(F&& f) {
  return
      [f](const Material& m) -> py::object { return m.pbr ? f(*m.pbr) : py::object(py::none()); };
}
template <typename F>
auto of_paper(F&& f) {
  return [f](const Material& m) -> py::object { return m.pbr ? py::object(py::none()) : f(m); };
}

auto pbr_number(float PbrMaterial::*number) {
  return of_pbr([number](const PbrMaterial& p) -> py::object { return py::float_(p.*number); });
}

std::string text_of(const Material& m) {
  const auto text = [](const py::object& value) {
    if (!py::isinstance<py::array>(value)) return std::string(py::repr(value));
    const py::array array = value;
    return "<texture " + std::to_string(array.shape(1)) + " x " + std::to_string(array.shape(0)) +
           ">";
  };
  if (!m.pbr)
    return "Material(diffuse=" + text(triple(m.diffuse)) + ", glossy=" + text(triple(m.glossy)) +
           ", exponent=" + text(py::float_(m.exponent)) + ", emission=" + text(triple(m.emission)) +
           ")";
  const PbrMaterial& p = *m.pbr;
  std::string out =
      "Material.pbr(base_color=" + text(colour_or_array(p.base_color, p.base_color_map)) +
      ", metallic=" + text(number_or_array(p.metallic, p.metallic_map)) +
      ", roughness=" + text(number_or_array(p.roughness, p.roughness_map));
  if (p.normal_map) out += ", normal=" + text(array_of(*p.normal_map));
  if (p.emission_map || p.emission != glm::vec3(0))
    out += ", emission=" + text(colour_or_array(p.emission, p.emission_map));
  if (p.anisotropy > 0) out += ", anisotropy=" + text(py::float_(p.anisotropy));
  if (p.ior != 1.5f) out += ", ior=" + text(py::float_(p.ior));
  if (p.specular != 1) out += ", specular=" + text(py::float_(p.specular));
  if (p.specular_color != glm::vec3(1)) out += ", specular_color=" + text(triple(p.specular_color));
  return out + ")";
}

py::tuple state_of(const Material& m) {
  if (!m.pbr)
    return py::make_tuple(triple(m.diffuse), triple(m.glossy), m.exponent, triple(m.emission));
  const PbrMaterial& p = *m.pbr;
  const auto map = [](const std::shared_ptr<const SurfaceTexture>& t) {
    return t ? py::object(image_array(t->level(0))) : py::object(py::none());
  };
  return py::make_tuple(triple(p.base_color), p.metallic, p.roughness, triple(p.emission),
                        p.anisotropy, p.anisotropy_rotation, p.normal_scale, map(p.base_color_map),
                        map(p.metallic_map), map(p.roughness_map), map(p.emission_map),
                        map(p.normal_map), wrap_of(p), p.ior, p.specular, triple(p.specular_color));
}

Material from_state(const py::tuple& t) {
  if (t.size() == 4)
    return Material{require_triple(t[0], "diffuse"),
                    require_triple(t[1], "glossy"),
                    t[2].cast<float>(),
                    require_triple(t[3], "emission"),
                    nullptr,
                    nullptr};
  PbrMaterial p;
  p.base_color = require_triple(t[0], "base_color"), p.metallic = t[1].cast<float>();
  p.roughness = t[2].cast<float>(), p.emission = require_triple(t[3], "emission");
  p.anisotropy = t[4].cast<float>(), p.anisotropy_rotation = t[5].cast<float>();
  p.normal_scale = t[6].cast<float>();
  std::shared_ptr<const SurfaceTexture>* maps[] = {
      &p.base_color_map, &p.metallic_map, &p.roughness_map, &p.emission_map, &p.normal_map};
  for (std::size_t i = 0; i < 5; ++i)
    if (const py::object array = t[7 + i]; !array.is_none())
      *maps[i] =
          texture(array, "texture", i == 1 || i == 2 ? 1 : 3, Coding::linear, wraps_of(t[12]));
  p.ior = t[13].cast<float>(), p.specular = t[14].cast<float>();
  p.specular_color = require_triple(t[15], "specular_color");
  return Material::make_pbr(p);
}

}  // namespace

void bind_material(py::module_& module) {
  py::class_<Material>(
      module, "Material",
      R"(Reflectance of Eq. 3, Croubois et al. 2014; see Material.pbr for glTF's model. Colours are linear RGB.

diffuse: k_L. glossy: k_G. exponent: s >= 0, half-vector exponent, may be infinite. emission: radiance. Raises
ValueError for negative values.)")
      .def(py::init([](const py::object& diffuse, const py::object& glossy, float exponent,
                       const py::object& emission) {
             Material m{require_triple(diffuse, "diffuse"),
                        require_triple(glossy, "glossy"),
                        exponent,
                        require_triple(emission, "emission"),
                        nullptr,
                        nullptr};
             m.validate();
             return m;
           }),
           py::arg("diffuse") = py::make_tuple(0.8, 0.8, 0.8),
           py::arg("glossy") = py::make_tuple(0.0, 0.0, 0.0), py::arg("exponent") = 64.0f,
           py::arg("emission") = py::make_tuple(0.0, 0.0, 0.0))
      .def_static(
          "pbr", &pbr, py::arg("base_color") = py::make_tuple(0.8, 0.8, 0.8),
          py::arg("metallic") = 0.0, py::arg("roughness") = 0.5, py::arg("normal") = py::none(),
          py::arg("emission") = py::make_tuple(0.0, 0.0, 0.0), py::kw_only(),
          py::arg("anisotropy") = 0.0f, py::arg("anisotropy_rotation") = 0.0f,
          py::arg("normal_scale") = 1.0f, py::arg("wrap") = "repeat", py::arg("ior") = 1.5f,
          py::arg("specular") = 1.0f, py::arg("specular_color") = py::make_tuple(1.0, 1.0, 1.0),
          R"(glTF's metallic-roughness model: GGX with Fresnel (Schlick, 4 % for what is not metal), compensated for
multiple scattering, over a diffuse base.

base_color, emission: three linear numbers, or a texture (height, width, 3): uint8 is sRGB, floats are linear.
metallic, roughness: a number in [0, 1], or a texture (height, width): uint8 divided by 255, floats as they are.
normal: a texture (height, width, 3) of vectors in tangent space, encoded 0 to 1 (floats) or 0 to 255 (uint8), y along
growing v; x and y are multiplied by normal_scale; or None.
anisotropy: strength in [0, 1] (KHR_materials_anisotropy): the roughness along the tangent, which points where u grows,
turned by anisotropy_rotation (radians) towards where v grows.
Without uvs the tangent runs around the mesh's z axis, and Scene refuses textures.
Textures are filtered trilinearly; wrap: how they go on beyond their edges, "repeat", "clamp" (their border) or
"mirror", or two of these, along u and v.
ior, specular, specular_color: of what is not metal (KHR_materials_ior, KHR_materials_specular). The index of
refraction, at least 1, or 0 for a mirror; the strength in [0, 1] of what it reflects; and a linear RGB factor on what
it reflects along the normal, ((ior - 1) / (ior + 1))^2. What it does not reflect goes into the diffuse base.
Raises ValueError for values out of range or another shape, TypeError for another dtype.)")
      .def_property_readonly(
          "model", [](const Material& m) { return m.pbr ? "pbr" : "blinn-phong"; },
          "\"blinn-phong\" (Eq. 3) or \"pbr\".")
      .def_property_readonly(
          "diffuse", of_paper([](const Material& m) -> py::object { return triple(m.diffuse); }),
          "k_L; None for a pbr material.")
      .def_property_readonly(
          "glossy", of_paper([](const Material& m) -> py::object { return triple(m.glossy); }),
          "k_G; None for a pbr material.")
      .def_property_readonly("exponent", of_paper([](const Material& m) -> py::object {
                               return py::float_(m.exponent);
                             }),
                             "s; None for a pbr material.")
      .def_property_readonly(
          "emission",
          [](const Material& m) {
            return m.pbr ? colour_or_array(m.pbr->emission, m.pbr->emission_map)
                         : py::object(triple(m.emission));
          },
          "Radiance: three numbers, or a texture.")
      .def_property_readonly("base_color", of_pbr([](const PbrMaterial& p) {
                               return colour_or_array(p.base_color, p.base_color_map);
                             }),
                             "Three linear numbers or a linear texture; None for Eq. 3.")
      .def_property_readonly("metallic", of_pbr([](const PbrMaterial& p) {
                               return number_or_array(p.metallic, p.metallic_map);
                             }),
                             "A number or a texture; None of Eq. 3.")
      .def_property_readonly("roughness", of_pbr([](const PbrMaterial& p) {
                               return number_or_array(p.roughness, p.roughness_map);
                             }),
                             "A number or a texture; None of Eq. 3.")
      .def_property_readonly("normal", of_pbr([](const PbrMaterial& p) {
                               return p.normal_map ? array_of(*p.normal_map, Coding::normal)
                                                   : py::object(py::none());
                             }),
                             "The normal map, encoded 0 to 1, or None.")
      .def_property_readonly("anisotropy", pbr_number(&PbrMaterial::anisotropy),
                             "0 (round lobe) to 1, as in KHR_materials_anisotropy; None for Eq. 3.")
      .def_property_readonly("anisotropy_rotation", pbr_number(&PbrMaterial::anisotropy_rotation),
                             "Radians from the tangent, counter-clockwise; None for Eq. 3.")
      .def_property_readonly("normal_scale", pbr_number(&PbrMaterial::normal_scale),
                             "Factor on the normal map's x and y; None for Eq. 3.")
      .def_property_readonly("ior", pbr_number(&PbrMaterial::ior),
                             "Index of refraction of what is not metal; None for Eq. 3.")
      .def_property_readonly("specular", pbr_number(&PbrMaterial::specular),
                             "Strength of what reflects without being metal; None for Eq. 3.")
      .def_property_readonly("specular_color", of_pbr([](const PbrMaterial& p) -> py::object {
                               return triple(p.specular_color);
                             }),
                             "Factor (RGB) on what it reflects along the normal; None for Eq. 3.")
      .def_property_readonly("wrap", of_pbr(&wrap_of),
                             "How textures go on beyond their edges along u and v; None for Eq. 3.")
      .def(
          "__eq__", [](const Material& a, const Material& b) { return a == b; }, py::is_operator())
      .def("__repr__", &text_of)
      .def(py::pickle(&state_of, &from_state));
}

}  // namespace fastibl::bindings
