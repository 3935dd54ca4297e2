#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "bindings/numpy.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/bvh.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/equirect.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/scene/obj_file.h"
#include "fastibl/scene/wide_lens.h"

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

// Zero-copy view of one level; `owner` is kept alive by it.
py::array level_view(const CubeMap& cube, int k, const py::object& owner) {
  const CubeLevel& level = cube.level(k);
  const py::ssize_t n = level.size(), t = sizeof(glm::vec3);
  py::array view(py::dtype::of<float>(), {py::ssize_t{6}, n, n, py::ssize_t{3}},
                 {level.face_stride() * t, level.row_stride() * t, t, py::ssize_t(sizeof(float))},
                 &level.face(0)->x, owner);
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

void bind_cube(py::module_& module) {
  py::class_<CubeMap>(module, "CubeMap", R"(Linear radiance over the sphere, with its MIP chain.

faces: (6, n, n, 3), any float dtype, faces in the order +x -x +y -y +z -z with OpenGL's orientation; a
marker-frame direction is the OpenGL cube coordinate. NaN and negative values become 0, values above 1e9 (and
infinity) become 1e9; `cleaned` counts them. Raises ValueError for another shape, TypeError for integers.)")
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
                             "Number of MIP levels, the faces themselves among them.")
      .def_property_readonly(
          "tile_versions",
          [](const CubeMap& cube) {
            const int t = cube.tiles().per_edge();
            py::array_t<std::uint64_t> out({6, t, t});
            const auto versions = cube.tile_versions();
            std::copy(versions.begin(), versions.end(), out.mutable_data());
            return out;
          },
          R"((6, t, t) uint64, t = min(size, 16): where two maps of one size have the same number, they have the
same texels in that part of a face. For what is made from a map, to be renewed only where it changed.)")
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
          "Numbers of values that cleaning on entry changed: nan, negative, capped.")
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
              levels = py::module_::import("numpy").attr("broadcast_to")(
                  require_floats<float>(level, "level"), py::tuple(py::cast(shape)));
            }
            Floats out(shape_vector(in));
            const glm::vec3* d = vectors(in);
            glm::vec3* to = vectors(out);
            const float* per = scalar ? nullptr : levels.data();
            {
              const py::gil_scoped_release release;
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
        const py::gil_scoped_release release;
        return cubemap_from_equirect(
            view, size, filter == "area" ? EquirectFilter::area : EquirectFilter::point);
      },
      py::arg("image"), py::arg("size") = 128, py::arg("filter") = "area",
      R"(Cube map of an equirectangular picture.

filter: "area" is exact, the energy of each channel is kept; "point" is one bilinear look-up for each texel, faster,
for pictures about as fine as the map.

image: (height, width, 3) any float dtype, linear radiance; z at the top, the centre looks along +y, x grows to
the right. size: face edge in texels. Raises ValueError for another shape or filter, TypeError for integers.)");
  module.def(
      "equirect_from_cubemap",
      [](const CubeMap& cube, int height) {
        Image<float> image;
        {
          const py::gil_scoped_release release;
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

// Calls use(lens) with the lens of any camera.
template <typename Use>
void with_lens(const Camera& camera, Use use) {
  if (camera.model == CameraModel::perspective)
    use(Lens(camera));
  else
    use(WideLens(camera));
}

void bind_camera(py::module_& module) {
  py::class_<Response>(module, "Response",
                       "A camera's response: encoded = response(linear), white at 1.")
      .def_static("srgb", &Response::srgb, "The sRGB curve.")
      .def_static("gamma", &Response::gamma, py::arg("exponent"),
                  "linear = encoded ** exponent. Raises ValueError for an exponent that is not "
                  "positive and finite.")
      .def_static(
          "from_curve",
          [](const py::object& curve) {
            const Floats array = require_floats<float>(curve, "curve");
            return Response::from_curve({array.data(), array.data() + array.size()});
          },
          py::arg("curve"),
          "Linear values at evenly spaced encoded values, from 0 to 1: (n,) floats. 0 up to the "
          "black level and 1 from the white level on, strictly increasing between them. Raises "
          "ValueError for others.")
      .def(
          "between", &Response::between, py::arg("black"), py::arg("white"),
          "The same curve between other levels, encoded, to an eighth of an 8-bit code: "
          "Response.srgb().between(16 / 255, 235 / 255) for video whose black is 16 and white 235. "
          "Raises ValueError unless 0 <= black < white <= 1.")
      .def_property_readonly("black", &Response::black, "Encoded value of no light.")
      .def_property_readonly("white", &Response::white,
                             "Encoded value of light at and beyond which all is clipped.")
      .def_property_readonly(
          "curve",
          [](const Response& r) {
            return py::array_t<float>(py::ssize_t(r.curve.size()), r.curve.data());
          },
          "(n,) float32; empty for sRGB.")
      .def(
          "decode",
          [](const Response& r, const py::object& encoded) {
            Floats in = require_floats<float>(encoded, "encoded");
            Floats out(shape_vector(in));
            for (py::ssize_t i = 0; i < in.size(); ++i)
              out.mutable_data()[i] = r.decode(in.data()[i]);
            return out;
          },
          py::arg("encoded"),
          "Linear values float32 of encoded ones in [0, 1], any float dtype and shape.")
      .def(
          "encode",
          [](const Response& r, const py::object& linear) {
            Floats in = require_floats<float>(linear, "linear");
            Floats out(shape_vector(in));
            for (py::ssize_t i = 0; i < in.size(); ++i)
              out.mutable_data()[i] = r.encode(in.data()[i]);
            return out;
          },
          py::arg("linear"),
          "Encoded values float32 in [0, 1] of linear ones, any float dtype and shape.")
      .def(py::self == py::self)
      .def("__repr__",
           [](const Response& r) {
             return r.curve.empty()
                        ? std::string("Response.srgb()")
                        : "<fastibl.Response of " + std::to_string(r.curve.size()) + " points>";
           })
      .def(
          py::pickle([](const Response& r) { return py::make_tuple(r.curve); },
                     [](const py::tuple& t) { return Response{t[0].cast<std::vector<float>>()}; }));

  py::class_<Camera>(
      module, "Camera",
      R"(A camera with one of OpenCV's lens models. Frame: x right, y down, z forward.

width, height: pixels. fx, fy, cx, cy: pixels, pixel centres at (x + 0.5, y + 0.5) (see from_opencv). distortion:
k1 k2 p1 p2 [k3 [k4 k5 k6]]. response: encoded = response(exposure * gain * vignetting * radiance). vignetting:
v1, v2, ... of 1 + v1 r^2 + v2 r^4 + ..., r in units of the focal length. readout: seconds from a picture's first row
to its last: row r is exposed around time + r / height * readout. model: "perspective"; "fisheye" (Kannala and Brandt
2006 as in OpenCV, distortion k1 k2 k3 k4 or none); or "equirectangular" (longitude fx to the right and latitude fy
downwards, pixels a radian; see equirectangular()). The last two measure light, as a rig's front camera or in Capture;
boards are tracked in, and objects drawn over, perspective pictures. field_of_view: degrees across a fisheye's circle;
what lies outside, which most pictures have black, is not looked at; 360: all that the model reaches. Raises ValueError
for what is not a camera.)")
      .def(py::init([](int width, int height, double fx, double fy, double cx, double cy,
                       std::vector<double> distortion, const std::optional<Response>& response,
                       double gain, std::vector<double> vignetting, double readout,
                       const std::string& model, double field_of_view) {
             Camera camera{width,
                           height,
                           fx,
                           fy,
                           cx,
                           cy,
                           std::move(distortion),
                           response.value_or(Response{}),
                           gain,
                           std::move(vignetting),
                           readout,
                           camera_model(model),
                           field_of_view};
             camera.validate();
             return camera;
           }),
           py::arg("width"), py::arg("height"), py::arg("fx"), py::arg("fy"), py::arg("cx"),
           py::arg("cy"), py::arg("distortion") = std::vector<double>{},
           py::arg("response") = py::none(), py::arg("gain") = 1.0,
           py::arg("vignetting") = std::vector<double>{}, py::arg("readout") = 0.0,
           py::arg("model") = "perspective", py::arg("field_of_view") = 360.0)
      .def_static(
          "equirectangular",
          [](int width, int height, const std::optional<Response>& response, double gain) {
            Camera camera;
            camera.width = width, camera.height = height;
            camera.fx = 0.5 * width / std::numbers::pi, camera.fy = height / std::numbers::pi;
            camera.cx = 0.5 * width, camera.cy = 0.5 * height;
            camera.response = response.value_or(Response{}), camera.gain = gain;
            camera.model = CameraModel::equirectangular;
            camera.validate();
            return camera;
          },
          py::arg("width"), py::arg("height"), py::arg("response") = py::none(),
          py::arg("gain") = 1.0,
          "A 360° camera: all directions, z in the middle of the picture. width, height: pixels. "
          "Raises ValueError for a size below 1.")
      .def_static(
          "from_opencv",
          [](const py::object& K, std::vector<double> distortion, std::pair<int, int> size,
             const std::optional<Response>& response, double gain, std::vector<double> vignetting,
             double readout, const std::string& model, double field_of_view) {
            const Doubles k = require_floats<double>(K, "K");
            if (k.ndim() != 2 || k.shape(0) != 3 || k.shape(1) != 3)
              throw py::value_error("K must have shape (3, 3), got " + shape_of(k));
            if (k.at(0, 1) != 0)
              throw py::value_error("K has a skew of " + std::to_string(k.at(0, 1)) +
                                    "; expected one without");
            if (k.at(1, 0) != 0 || k.at(2, 0) != 0 || k.at(2, 1) != 0 || k.at(2, 2) != 1)
              throw py::value_error(
                  "K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got other values where 0 and 1 "
                  "are expected");
            Camera camera =
                Camera::from_opencv(size.first, size.second, k.at(0, 0), k.at(1, 1), k.at(0, 2),
                                    k.at(1, 2), std::move(distortion), camera_model(model));
            camera.response = response.value_or(Response{});
            camera.gain = gain, camera.vignetting = std::move(vignetting), camera.readout = readout;
            camera.field_of_view = field_of_view;
            camera.validate();
            return camera;
          },
          py::arg("K"), py::arg("distortion"), py::arg("size"), py::arg("response") = py::none(),
          py::arg("gain") = 1.0, py::arg("vignetting") = std::vector<double>{},
          py::arg("readout") = 0.0, py::arg("model") = "perspective",
          py::arg("field_of_view") = 360.0,
          "From OpenCV's camera matrix (3, 3), whose pixel centres are whole numbers; size = "
          "(width, height). model: \"perspective\", or \"fisheye\" for what cv2.fisheye "
          "calibrates. Raises ValueError for other shapes, a wrong number of coefficients or "
          "another model.")
      .def_property_readonly(
          "opencv_matrix",
          [](const Camera& c) {
            Doubles k({3, 3});
            std::fill_n(k.mutable_data(), 9, 0.0);
            k.mutable_at(0, 0) = c.fx, k.mutable_at(1, 1) = c.fy, k.mutable_at(2, 2) = 1;
            k.mutable_at(0, 2) = c.cx - 0.5, k.mutable_at(1, 2) = c.cy - 0.5;
            return k;
          },
          "(3, 3) float64 in OpenCV's convention.")
      .def_readonly("width", &Camera::width, "Pixels.")
      .def_readonly("height", &Camera::height, "Pixels.")
      .def_readonly("fx", &Camera::fx,
                    "Focal length along x, pixels; of an equirectangular camera pixels a radian.")
      .def_readonly("fy", &Camera::fy, "The same along y.")
      .def_readonly("cx", &Camera::cx, "Principal point, pixels, pixel centres at + 0.5.")
      .def_readonly("cy", &Camera::cy, "The same along y.")
      .def_property_readonly(
          "distortion", [](const Camera& c) { return py::tuple(py::cast(c.distortion)); },
          "k1 k2 p1 p2 [k3 [k4 k5 k6]]; of a fisheye k1 k2 k3 k4; empty for none.")
      .def_readonly("response", &Camera::response, "Response; sRGB by default.")
      .def_readonly("gain", &Camera::gain, "Factor on the exposure of all pictures.")
      .def_readonly("readout", &Camera::readout,
                    "Seconds from a picture's first row to its last; 0 for a global shutter.")
      .def_property_readonly(
          "model", [](const Camera& c) { return std::string(name(c.model)); },
          "\"perspective\", \"fisheye\" or \"equirectangular\".")
      .def_readonly("field_of_view", &Camera::field_of_view,
                    "Degrees across a fisheye's circle; 360: all that its model reaches.")
      .def_property_readonly(
          "vignetting", [](const Camera& c) { return py::tuple(py::cast(c.vignetting)); },
          "v1, v2, ... of 1 + v1 r^2 + v2 r^4 + ..., r in focal lengths; empty for none.")
      .def(
          "project",
          [](const Camera& camera, const py::object& points) {
            const Doubles in = require_floats<double>(points, "points");
            if (in.ndim() < 1 || in.shape(in.ndim() - 1) != 3)
              throw py::value_error("points must have shape (..., 3), got " + shape_of(in));
            std::vector<py::ssize_t> shape = shape_vector(in);
            shape.back() = 2;
            Doubles out(shape);
            with_lens(camera, [&](const auto& lens) {
              for (py::ssize_t i = 0; i < in.size() / 3; ++i) {
                const double* p = in.data() + 3 * i;
                const auto pixel = lens.project({p[0], p[1], p[2]});
                for (int c = 0; c < 2; ++c)
                  out.mutable_data()[2 * i + c] =
                      pixel ? (*pixel)[c] : std::numeric_limits<double>::quiet_NaN();
              }
            });
            return out;
          },
          py::arg("points"),
          "Pixels (..., 2) float64 of points (..., 3) in the camera frame; NaN behind a "
          "perspective "
          "camera and beyond the lens model.")
      .def(
          "unproject",
          [](const Camera& camera, const py::object& pixels) {
            const Doubles in = require_floats<double>(pixels, "pixels");
            if (in.ndim() < 1 || in.shape(in.ndim() - 1) != 2)
              throw py::value_error("pixels must have shape (..., 2), got " + shape_of(in));
            std::vector<py::ssize_t> shape = shape_vector(in);
            shape.back() = 3;
            Doubles out(shape);
            with_lens(camera, [&](const auto& lens) {
              for (py::ssize_t i = 0; i < in.size() / 2; ++i) {
                const auto ray = lens.unproject({in.data()[2 * i], in.data()[2 * i + 1]});
                for (int c = 0; c < 3; ++c)
                  out.mutable_data()[3 * i + c] =
                      ray ? (*ray)[c] : std::numeric_limits<double>::quiet_NaN();
              }
            });
            return out;
          },
          py::arg("pixels"),
          "Directions (..., 3) float64 through pixels (..., 2): z = 1 of a perspective camera, "
          "else "
          "of unit length; NaN beyond the lens model. Raises ValueError for another shape.")
      .def(py::self == py::self)
      .def(
          "__repr__",
          [](const Camera& c) {
            return "Camera(" + std::to_string(c.width) + ", " + std::to_string(c.height) +
                   ", fx=" + std::string(py::repr(py::float_(c.fx))) +
                   ", fy=" + std::string(py::repr(py::float_(c.fy))) +
                   ", cx=" + std::string(py::repr(py::float_(c.cx))) +
                   ", cy=" + std::string(py::repr(py::float_(c.cy))) +
                   ", distortion=" + std::string(py::repr(py::cast(c.distortion))) +
                   (c.model == CameraModel::perspective
                        ? ")"
                        : ", model='" + std::string(name(c.model)) + "'" +
                              (c.field_of_view == 360
                                   ? ")"
                                   : ", field_of_view=" +
                                         std::string(py::repr(py::float_(c.field_of_view))) + ")"));
          })
      .def(
          "replace",
          [](const py::object& self, const py::kwargs& changes) {
            py::dict arguments;
            for (const char* name :
                 {"width", "height", "fx", "fy", "cx", "cy", "distortion", "response", "gain",
                  "vignetting", "readout", "model", "field_of_view"})
              arguments[name] = self.attr(name);
            for (const auto& [name, value] : changes) arguments[name] = value;
            return py::type::of(self)(**arguments).cast<Camera>();
          },
          "The same camera with some arguments of the constructor changed: "
          "camera.replace(readout=0.03). Raises what the constructor raises.")
      .def("__copy__", [](const Camera& c) { return c; })
      .def(
          "__deepcopy__", [](const Camera& c, const py::dict&) { return c; }, py::arg("memo"))
      .def(py::pickle(
          [](const Camera& c) {
            return py::make_tuple(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.distortion,
                                  c.response, c.gain, c.vignetting, c.readout, int(c.model),
                                  c.field_of_view);
          },
          [](const py::tuple& t) {
            return Camera{t[0].cast<int>(),
                          t[1].cast<int>(),
                          t[2].cast<double>(),
                          t[3].cast<double>(),
                          t[4].cast<double>(),
                          t[5].cast<double>(),
                          t[6].cast<std::vector<double>>(),
                          t[7].cast<Response>(),
                          t[8].cast<double>(),
                          t[9].cast<std::vector<double>>(),
                          t.size() > 10 ? t[10].cast<double>() : 0,
                          t.size() > 11 ? CameraModel(t[11].cast<int>()) : CameraModel::perspective,
                          t.size() > 12 ? t[12].cast<double>() : 360};
          }));

  py::class_<Rig>(module, "Rig",
                  R"(A back camera, and a front camera fixed to it.

back: perspective Camera. front: Camera of any model, or None. front_from_back: Pose or (4, 4) float64 in metres, from
the back camera's frame to the front camera's. Raises ValueError for one of the two without the other, or what is no
pose.)")
      .def(py::init([](const Camera& back, const std::optional<Camera>& front,
                       const py::object& front_from_back) {
             if (front.has_value() == front_from_back.is_none())
               throw py::value_error("a rig needs both front and front_from_back, or neither");
             return Rig{back, front,
                        front ? require_pose(front_from_back, "front_from_back") : Pose{}};
           }),
           py::arg("back"), py::arg("front") = py::none(), py::arg("front_from_back") = py::none())
      .def_readonly("back", &Rig::back, "Camera that sees the board.")
      .def_readonly("front", &Rig::front, "Camera that looks the other way, or None.")
      .def_readonly("front_from_back", &Rig::front_from_back,
                    "Pose; the identity without a front camera.")
      .def(py::self == py::self)
      .def(py::pickle(
          [](const Rig& r) { return py::make_tuple(r.back, r.front, r.front_from_back); },
          [](const py::tuple& t) {
            check(t.size() == 3, "the pickled state is no Rig's");
            return Rig{t[0].cast<Camera>(), t[1].cast<std::optional<Camera>>(), t[2].cast<Pose>()};
          }))
      .def("__repr__", [](const Rig& r) {
        return std::string("<fastibl.Rig ") + (r.front ? "back and front camera>" : "back camera>");
      });
}

Doubles corners_of(const Tag& tag) {
  Doubles out({4, 2});
  for (int i = 0; i < 4; ++i) {
    out.mutable_at(i, 0) = tag.corners[std::size_t(i)].x;
    out.mutable_at(i, 1) = tag.corners[std::size_t(i)].y;
  }
  return out;
}

int tag_id(const py::object& id) {
  if (!PyIndex_Check(id.ptr()))
    throw py::type_error("a tag's id must be a whole number, got " +
                         std::string(py::str(py::type::handle_of(id).attr("__name__"))));
  const Py_ssize_t value = PyNumber_AsSsize_t(id.ptr(), PyExc_ValueError);
  if (value == -1 && PyErr_Occurred()) throw py::error_already_set();
  return int(std::clamp<Py_ssize_t>(value, -1, std::numeric_limits<int>::max()));
}

Board board_from(const py::sequence& tags, double width, double height, int border_bits) {
  Board board;
  board.border_bits = border_bits, board.width = width, board.height = height;
  for (const py::handle item : tags) {
    if (!py::isinstance<py::sequence>(item) || py::len(item) != 2)
      throw py::type_error("a tag must be (id, corners), got " +
                           std::string(py::str(py::type::handle_of(item).attr("__name__"))));
    const auto pair = py::reinterpret_borrow<py::sequence>(item);
    const Doubles c = require_floats<double>(py::object(pair[1]), "corners");
    if (c.ndim() != 2 || c.shape(0) != 4 || c.shape(1) != 2)
      throw py::value_error("corners must have shape (4, 2), got " + shape_of(c));
    Tag tag{tag_id(pair[0]), {}};
    for (int i = 0; i < 4; ++i) tag.corners[std::size_t(i)] = {c.at(i, 0), c.at(i, 1)};
    board.tags.push_back(tag);
  }
  board.validate();
  return board;
}

std::string millimetres(double metres) {
  return py::str(py::float_(std::round(metres * 1e4) / 10));
}

void bind_board(py::module_& module) {
  py::class_<Tag>(module, "Tag",
                  "A tag of a board: id, and corners (4, 2) in metres (upper left, upper right, "
                  "lower right, lower left).")
      .def_readonly("id", &Tag::id, "Number in family 36h11, 0 to 586.")
      .def_property_readonly("corners", &corners_of, "(4, 2) float64 metres, marker frame.")
      .def(py::self == py::self)
      .def("__repr__", [](const Tag& t) { return "<fastibl.Tag " + std::to_string(t.id) + ">"; });
  py::class_<Board>(
      module, "Board",
      R"(The printed board: tags of family 36h11 on the plane z = 0 of the marker frame.

tags: [(id, corners (4, 2))], corners of the black border in metres, x right, y up, origin at the page's centre:
upper left, upper right, lower right, lower left as the tag is read. border_bits: width of the black border in
modules. width, height: of the page in metres. Raises ValueError for no tags, an id twice or outside 0 to 586.)")
      .def(py::init(&board_from), py::arg("tags"), py::arg("width"), py::arg("height"),
           py::arg("border_bits") = 1)
      .def_static("default", &Board::default_board,
                  "A large tag with small ones around it, on A4 landscape: seen near and far, and "
                  "partly hidden.")
      .def_static("grid", &Board::grid, py::arg("rows"), py::arg("columns"), py::arg("tag_size"),
                  py::arg("spacing"), py::arg("border_bits") = 1,
                  "rows x columns tags of tag_size metres, spacing metres apart; ids from 0 row by "
                  "row from the top. Raises ValueError for less than one tag or lengths that are "
                  "not positive.")
      .def_static("kalibr", &Board::kalibr, py::arg("rows"), py::arg("columns"),
                  py::arg("tag_size"), py::arg("spacing_ratio") = 0.3,
                  "Kalibr's AprilGrid: two-module borders, ids from 0 row by row from the bottom; "
                  "spacing_ratio = space between tags / tag_size (metres). Raises ValueError for "
                  "less than one tag or lengths that are not positive.")
      .def_readonly("tags", &Board::tags, "List of Tag.")
      .def_readonly("border_bits", &Board::border_bits, "Width of the black border in modules.")
      .def_readonly("width", &Board::width, "Page width in metres.")
      .def_readonly("height", &Board::height, "Page height in metres.")
      // Drawing is Python's (the library reads and writes no files); the class stays one.
      .def(
          "image",
          [](const py::object& self, double dpi) {
            return py::module_::import("fastibl.board").attr("draw_board")(self, dpi);
          },
          py::arg("dpi") = 300.0,
          "The page as (height, width) uint8 grey values, white 255; edges carry exact coverage. "
          "Pixel (0, 0) is the page's upper left corner. Raises ValueError for dpi outside 10 to "
          "2400.")
      .def(
          "save",
          [](const py::object& self, const py::object& path, double dpi) {
            py::module_::import("fastibl.board").attr("save_board")(self, path, dpi);
          },
          py::arg("path"), py::arg("dpi") = 300.0,
          R"(Writes the page at true size: .png with its resolution inside, or .pdf as vectors (needs
fastibl[board]). Print at 100 % and measure the line below the tags. Raises ValueError for another ending.)")
      .def(py::self == py::self)
      .def("__repr__",
           [](const Board& b) {
             return "<fastibl.Board of " + std::to_string(b.tags.size()) + " tags, " +
                    millimetres(b.width) + " x " + millimetres(b.height) + " mm>";
           })
      .def("__copy__", [](const Board& b) { return b; })
      .def(
          "__deepcopy__", [](const Board& b, const py::dict&) { return b; }, py::arg("memo"))
      .def(py::pickle(
          [](const Board& b) {
            py::list tags;
            for (const Tag& tag : b.tags) tags.append(py::make_tuple(tag.id, corners_of(tag)));
            return py::make_tuple(tags, b.width, b.height, b.border_bits);
          },
          [](const py::tuple& t) {
            return board_from(t[0], t[1].cast<double>(), t[2].cast<double>(), t[3].cast<int>());
          }));
}

void bind_mesh(py::module_& module) {
  module.def(
      "_read_obj",
      [](const py::bytes& content) {
        const std::string_view text = content;
        const py::gil_scoped_release release;
        return read_obj(text);
      },
      py::arg("content"));
  module.def(
      "_polygon_triangles",
      [](const py::array_t<double, py::array::c_style | py::array::forcecast>& corners) {
        if (corners.ndim() != 2 || corners.shape(1) != 3)
          throw py::value_error("corners must have shape (n, 3), got " + shape_of(corners));
        std::vector<glm::dvec3> polygon;
        for (py::ssize_t i = 0; i < corners.shape(0); ++i)
          polygon.emplace_back(corners.at(i, 0), corners.at(i, 1), corners.at(i, 2));
        const std::vector<glm::ivec3> found = polygon_triangles(polygon);
        py::array_t<int> out({py::ssize_t(found.size()), py::ssize_t{3}});
        std::memcpy(out.mutable_data(), found.data(), found.size() * sizeof(glm::ivec3));
        return out;
      },
      py::arg("corners"));
  py::class_<Mesh>(module, "Mesh", R"(Triangle mesh.

vertices: (v, 3) any float dtype, metres. triangles: (t, 3) integers, counter-clockwise from outside. uvs: (v, 2)
or None; (0, 0) is the lower left corner of a texture, which repeats. normals: (v, 3), or None to work them out.
Raises ValueError for wrong shapes, indices out of range, or values that are not finite.)")
      .def(py::init([](const py::object& vertices, const py::object& triangles,
                       const py::object& uvs, const py::object& normals) {
             const Floats v = require_vectors(vertices, "vertices");
             if (v.ndim() != 2)
               throw py::value_error("vertices must have shape (v, 3), got " + shape_of(v));
             const py::array t = py::array::ensure(triangles);
             if (!t || (t.dtype().kind() != 'i' && t.dtype().kind() != 'u')) {
               PyErr_Clear();
               throw py::type_error("triangles must hold integers");
             }
             if (t.ndim() != 2 || t.shape(1) != 3)
               throw py::value_error("triangles must have shape (t, 3), got " + shape_of(t));
             const auto wide =
                 py::array_t<long long, py::array::c_style | py::array::forcecast>::ensure(t);
             Mesh mesh;
             mesh.vertices.assign(vectors(v), vectors(v) + v.shape(0));
             for (py::ssize_t i = 0; i < wide.shape(0); ++i) {
               glm::ivec3 triangle;
               for (int c = 0; c < 3;
                    ++c)  // an index beyond int is out of range; −1 is reported as such
                 triangle[c] =
                     wide.at(i, c) > 0x7fffffff || wide.at(i, c) < 0 ? -1 : int(wide.at(i, c));
               mesh.triangles.push_back(triangle);
             }
             if (!uvs.is_none()) {
               const Floats uv = require_floats<float>(uvs, "uvs");
               if (uv.ndim() != 2 || uv.shape(1) != 2)
                 throw py::value_error("uvs must have shape (v, 2), got " + shape_of(uv));
               for (py::ssize_t i = 0; i < uv.shape(0); ++i)
                 mesh.uvs.push_back({uv.at(i, 0), uv.at(i, 1)});
             }
             if (!normals.is_none()) {
               const Floats n = require_vectors(normals, "normals");
               if (n.ndim() != 2)
                 throw py::value_error("normals must have shape (v, 3), got " + shape_of(n));
               mesh.normals.assign(vectors(n), vectors(n) + n.shape(0));
             }
             mesh.validate();
             return mesh;
           }),
           py::arg("vertices"), py::arg("triangles"), py::arg("uvs") = py::none(),
           py::arg("normals") = py::none())
      .def_property_readonly(
          "vertices",
          [](const Mesh& m) {
            Floats out({py::ssize_t(m.vertices.size()), py::ssize_t{3}});
            std::copy(m.vertices.begin(), m.vertices.end(), vectors(out));
            return out;
          },
          "(v, 3) float32 metres, a copy.")
      .def_property_readonly(
          "triangles",
          [](const Mesh& m) {
            py::array_t<int> out({py::ssize_t(m.triangles.size()), py::ssize_t{3}});
            std::memcpy(out.mutable_data(), m.triangles.data(),
                        m.triangles.size() * sizeof(glm::ivec3));
            return out;
          },
          "(t, 3) int32, a copy.")
      .def_property_readonly(
          "uvs",
          [](const Mesh& m) -> py::object {
            if (m.uvs.empty()) return py::none();
            Floats out({py::ssize_t(m.uvs.size()), py::ssize_t{2}});
            std::memcpy(out.mutable_data(), m.uvs.data(), m.uvs.size() * sizeof(glm::vec2));
            return out;
          },
          "(v, 2) float32, a copy, or None.")
      .def_property_readonly(
          "normals",
          [](const Mesh& m) {
            const std::vector<glm::vec3> normals = vertex_normals(m);
            Floats out({py::ssize_t(normals.size()), py::ssize_t{3}});
            std::copy(normals.begin(), normals.end(), vectors(out));
            return out;
          },
          "(v, 3) float32 unit vertex normals: those given, else weighted by angle.")
      .def_property_readonly(
          "tangents",
          [](const Mesh& m) {
            const std::vector<glm::vec4> tangents = vertex_tangents(m, vertex_normals(m));
            Floats out({py::ssize_t(tangents.size()), py::ssize_t{4}});
            std::memcpy(out.mutable_data(), tangents.data(), tangents.size() * sizeof(glm::vec4));
            return out;
          },
          "(v, 4) float32: unit direction in which u grows, and the side (1 or -1) of normal x "
          "tangent on which v does; around the z axis where there are no uvs.")
      .def_property_readonly("_given_normals",
                             [](const Mesh& m) -> py::object {
                               if (m.normals.empty()) return py::none();
                               Floats out({py::ssize_t(m.normals.size()), py::ssize_t{3}});
                               std::copy(m.normals.begin(), m.normals.end(), vectors(out));
                               return out;
                             })
      .def(py::self == py::self)
      .def("__repr__",
           [](const Mesh& m) {
             return "<fastibl.Mesh of " + std::to_string(m.vertices.size()) + " vertices, " +
                    std::to_string(m.triangles.size()) + " triangles>";
           })
      .def(py::pickle(
          [](const py::object& self) {
            return py::make_tuple(py::object(self.attr("vertices")),
                                  py::object(self.attr("triangles")), py::object(self.attr("uvs")),
                                  py::object(self.attr("_given_normals")));
          },
          [](const py::tuple& t) {
            return py::type::of<Mesh>()(t[0], t[1], t[2], t[3]).cast<Mesh>();
          }));

  py::class_<Bvh>(module, "Bvh", R"(Ray queries on a mesh. Triangles are two-sided.

mesh: Mesh; rays are in its frame, lengths in metres. Origins and directions are (..., 3) of any float dtype; t counts
in lengths of the direction. Raises ValueError for other shapes, TypeError for integers.)")
      .def(py::init([](const Mesh& mesh) {
             const py::gil_scoped_release release;
             return Bvh(mesh);
           }),
           py::arg("mesh"))
      .def(
          "occluded",
          [](const Bvh& bvh, const py::object& origins, const py::object& directions, float t_min) {
            const Floats o = require_vectors(origins, "origins"),
                         d = require_vectors(directions, "directions");
            if (o.ndim() > 1 && shape_vector(o) != shape_vector(d))
              throw py::value_error(
                  "origins must be one point, or have the shape of directions; got " + shape_of(o) +
                  " and " + shape_of(d));
            std::vector<py::ssize_t> shape = shape_vector(d);
            shape.pop_back();
            py::array_t<bool> out(shape);
            bool* to = out.mutable_data();
            if (o.ndim() == 1) {
              const py::gil_scoped_release release;
              DirectionSet set(int(d.size() / 3));
              for (int i = 0; i < set.count; ++i) set.set(i, vectors(d)[i]);
              std::vector<std::uint8_t> hidden(std::size_t(set.count), 0);
              bvh.occluded(vectors(o)[0], set, t_min, hidden);
              std::copy(hidden.begin(), hidden.end(), to);
              return out;
            }
            {
              const py::gil_scoped_release release;
              parallel_for(int(o.size() / 3), 1024, [&](int begin, int end) {
                for (int i = begin; i < end; ++i)
                  to[i] = bvh.occluded({vectors(o)[i], vectors(d)[i], t_min});
              });
            }
            return out;
          },
          py::arg("origins"), py::arg("directions"), py::arg("t_min") = 0.0f,
          R"(Whether the rays (..., 3) meet the mesh beyond t_min; (...) bool.

origins may be one point (3,) for all directions, which is several times faster.)")
      .def(
          "nearest",
          [](const Bvh& bvh, const py::object& origins, const py::object& directions, float t_min) {
            const Floats o = require_vectors(origins, "origins"),
                         d = require_vectors(directions, "directions");
            if (shape_vector(o) != shape_vector(d))
              throw py::value_error("origins and directions must have the same shape, got " +
                                    shape_of(o) + " and " + shape_of(d));
            std::vector<py::ssize_t> shape = shape_vector(o);
            shape.pop_back();
            py::array_t<int> triangle(shape);
            Floats t(shape);
            shape.push_back(2);
            Floats uv(shape);
            int* to = triangle.mutable_data();
            float *tt = t.mutable_data(), *tuv = uv.mutable_data();
            {
              const py::gil_scoped_release release;
              parallel_for(int(o.size() / 3), 1024, [&](int begin, int end) {
                for (int i = begin; i < end; ++i) {
                  const Bvh::Hit hit = bvh.nearest({vectors(o)[i], vectors(d)[i], t_min});
                  to[i] = hit.triangle,
                  tt[i] = hit.triangle < 0 ? std::numeric_limits<float>::infinity() : hit.t;
                  tuv[2 * i] = hit.u, tuv[2 * i + 1] = hit.v;
                }
              });
            }
            return py::make_tuple(triangle, t, uv);
          },
          py::arg("origins"), py::arg("directions"), py::arg("t_min") = 0.0f,
          "First hits of the rays (..., 3): triangle index (-1: none), t, and barycentric (u, v) "
          "of its second and third vertex.");
}

}  // namespace

void bind_scene(py::module_& module) {
  bind_cube(module);
  bind_camera(module);
  bind_board(module);
  bind_mesh(module);
}

}  // namespace fastibl::bindings
