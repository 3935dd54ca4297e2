// The border to NumPy: shape and dtype are checked, any float dtype and stride is converted on
// purpose, and everything else is refused with the name of what was given.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "bindings/gil.h"
#include "fastibl/core/pose.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/picture.h"

namespace py = pybind11;

namespace fastibl::bindings {

using Floats = py::array_t<float, py::array::c_style>;
using Doubles = py::array_t<double, py::array::c_style>;

inline std::string shape_of(const py::array& array) { return py::str(array.attr("shape")); }
inline std::string type_name(const py::handle& object) {
  return py::str(py::type::handle_of(object).attr("__name__"));
}

// Whether this is a Python number, or a NumPy number of any type.
inline bool is_number(const py::object& object) {
  return py::isinstance<py::float_>(object) || py::isinstance<py::int_>(object) ||
         py::isinstance(object, py::module_::import("numpy").attr("number"));
}

// Takes a NumPy array, or what NumPy turns into a float array (a list of numbers). Bare numbers,
// integers and objects are refused with a TypeError.
inline py::array require_array(const py::object& object, const char* name) {
  if (!py::isinstance<py::array>(object)) {
    if (!py::isinstance<py::sequence>(object) || py::isinstance<py::str>(object))
      throw py::type_error(std::string(name) + " must be an array of floats, got " +
                           type_name(object));
    // Lists and tuples are small and typed by hand: whole numbers in them are meant as floats.
    py::array array = py::array::ensure(object);
    if (!array) {
      PyErr_Clear();
      throw py::type_error(std::string(name) +
                           " must be an array of floats, got a sequence that is none");
    }
    if (array.dtype().kind() == 'i') return py::array(array.attr("astype")("float64"));
    return array;
  }
  return py::reinterpret_borrow<py::array>(object);
}

template <typename T>
py::array_t<T, py::array::c_style> require_floats(const py::object& object, const char* name) {
  const py::array array = require_array(object, name);
  if (array.dtype().kind() != 'f')
    throw py::type_error(std::string(name) + " must hold floats, got dtype " +
                         std::string(py::str(array.dtype())));
  return py::array_t<T, py::array::c_style | py::array::forcecast>::ensure(array);
}

// (..., 3) of any float dtype.
inline Floats require_vectors(const py::object& object, const char* name) {
  const Floats array = require_floats<float>(object, name);
  if (array.ndim() < 1 || array.shape(array.ndim() - 1) != 3)
    throw py::value_error(std::string(name) + " must have shape (..., 3), got " + shape_of(array));
  return array;
}

inline glm::dmat4 require_matrix(const py::object& object, const char* name) {
  const Doubles array = require_floats<double>(object, name);
  if (array.ndim() != 2 || array.shape(0) != 4 || array.shape(1) != 4)
    throw py::value_error(std::string(name) + " must have shape (4, 4), got " + shape_of(array));
  glm::dmat4 matrix;
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) matrix[c][r] = array.at(r, c);
  return matrix;
}

// Takes anything that makes a (3, 3) array; the core checks whether it is a rotation.
inline glm::dmat3 require_rotation(const py::object& object, const char* name) {
  const Doubles array = Doubles::ensure(object);
  if (!array || array.ndim() != 2 || array.shape(0) != 3 || array.shape(1) != 3)
    throw py::value_error(std::string(name) + " must be a rotation, (3, 3), got " +
                          std::string(py::repr(object)));
  glm::dmat3 rotation;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) rotation[c][r] = array.at(r, c);
  return rotation;
}

// A Pose object or a (4, 4) array.
inline Pose require_pose(const py::object& object, const char* name) {
  if (py::isinstance<Pose>(object)) return object.cast<Pose>();
  return Pose::from_matrix(require_matrix(object, name));
}

inline Doubles matrix_array(const glm::dmat4& matrix) {
  Doubles array({4, 4});
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) array.mutable_at(r, c) = matrix[c][r];
  return array;
}

// The array's memory as n packed vec3.
inline const glm::vec3* vectors(const Floats& array) {
  return reinterpret_cast<const glm::vec3*>(array.data());
}
inline glm::vec3* vectors(Floats& array) {
  return reinterpret_cast<glm::vec3*>(array.mutable_data());
}

inline glm::vec3 unit(glm::vec3 v) {
  const glm::vec3 size = glm::abs(v);
  const float most = std::max({size.x, size.y, size.z});
  if (std::isinf(most)) {  // beyond floats: beside what is infinite, all else counts as 0
    for (int c = 0; c < 3; ++c) v[c] = std::isinf(v[c]) ? std::copysign(1.0f, v[c]) : 0.0f;
  } else if (most > 0 && !(most > 1e-15f && most < 1e15f)) {  // squares would leave the floats
    v /= most;
  }
  const float length = glm::length(v);
  // What has no direction counts as upwards: the result is defined, not useful.
  return length > 0 ? v / length : size == glm::vec3(0) ? glm::vec3(0, 0, 1) : v;
}

inline std::vector<py::ssize_t> shape_vector(const py::array& array) {
  return {array.shape(), array.shape() + array.ndim()};
}

// Floats of any shape, or one number of any kind.
inline Floats require_numbers(const py::object& value, const char* name) {
  if (!is_number(value)) return require_floats<float>(value, name);
  return Floats::ensure(py::module_::import("numpy").attr("float32")(py::float_(value)));
}

// A number or an array of floats, broadcast to `shape`.
inline Floats broadcast_floats(const py::object& value, const char* name,
                               const std::vector<py::ssize_t>& shape) {
  const py::module_ numpy = py::module_::import("numpy");
  const Floats array = require_numbers(value, name);
  const py::tuple wanted{py::cast(shape)};
  try {
    return Floats::ensure(
        numpy.attr("ascontiguousarray")(numpy.attr("broadcast_to")(array, wanted)));
  } catch (py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError)) throw;
    throw py::value_error(std::string(name) + " must be a number or broadcast to " +
                          std::string(py::str(wanted)) + ", got shape " + shape_of(array));
  }
}

// uint8 or uint16 encoded RGB, or float linear RGB, (height, width, 3). `keep` owns the memory
// used.
inline Picture require_picture(const py::object& object, const char* name, py::array& keep) {
  if (!py::isinstance<py::array>(object))
    throw py::type_error(std::string(name) + " must be an array (height, width, 3), got " +
                         type_name(object));
  py::array array = py::reinterpret_borrow<py::array>(object);
  const char kind = array.dtype().kind();
  const auto size = array.dtype().itemsize();
  constexpr int kPixels =
      py::array::c_style | py::array::forcecast | py::detail::npy_api::NPY_ARRAY_ALIGNED_;
  Picture picture;
  if (kind == 'u' && size == 1)
    picture.type = PixelType::uint8;
  else if (kind == 'u' && size == 2)
    picture.type = PixelType::uint16;
  else if (kind == 'f')
    picture.type = PixelType::float32;
  else
    throw py::type_error(std::string(name) +
                         " must be uint8, uint16 (encoded) or float (linear), got dtype " +
                         std::string(py::str(array.dtype())));
  if (array.ndim() != 3 || array.shape(2) != 3 || array.shape(0) < 1 || array.shape(1) < 1)
    throw py::value_error(std::string(name) + " must have shape (height, width, 3), got " +
                          shape_of(array));
  if (picture.type == PixelType::float32)
    keep = py::array_t<float, kPixels>::ensure(array);
  else if (picture.type == PixelType::uint16)  // of either byte order
    keep = py::array_t<std::uint16_t, kPixels>::ensure(array);
  else
    keep = py::array::ensure(array, py::array::c_style);
  picture.data = keep.data();
  picture.height = int(keep.shape(0)), picture.width = int(keep.shape(1));
  return picture;
}

// Copies an (n, n, …) image out that a C++ value owns.
template <typename T>
py::array_t<T> image_array(const Image<T>& image) {
  std::vector<py::ssize_t> shape{image.height, image.width};
  if (image.channels != 1) shape.push_back(image.channels);
  py::array_t<T> array(shape);
  std::memcpy(array.mutable_data(), image.data.data(), image.data.size() * sizeof(T));
  return array;
}

// The other way: an image from an array (h, w, channels).
inline Image<float> image_from(const py::object& object, int channels) {
  const Floats array = require_floats<float>(object, "image");
  if (array.ndim() != 3 || array.shape(2) != channels)
    throw py::value_error("expected an image of " + std::to_string(channels) +
                          " channels, got shape " + shape_of(array));
  Image<float> image(int(array.shape(1)), int(array.shape(0)), channels);
  std::copy_n(array.data(), image.data.size(), image.data.data());
  return image;
}

inline std::vector<glm::vec3> require_colours(const py::object& object, const char* name) {
  const Floats array = require_vectors(object, name);
  return {vectors(array), vectors(array) + array.size() / 3};
}

// Three numbers.
inline glm::vec3 require_triple(const py::object& object, const char* name) {
  const Floats array = require_floats<float>(object, name);
  if (array.ndim() != 1 || array.size() != 3)
    throw py::value_error(std::string(name) + " must be three numbers, got shape " +
                          shape_of(array));
  return {array.at(0), array.at(1), array.at(2)};
}
template <typename T>
py::tuple triple(const glm::vec<3, T>& v) {
  return py::make_tuple(v.x, v.y, v.z);
}

}  // namespace fastibl::bindings
