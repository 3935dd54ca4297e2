#include "fastibl/scene/camera.h"

#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "bindings/numpy.h"
#include "fastibl/core/check.h"
#include "fastibl/scene/wide_lens.h"

namespace fastibl::bindings {
namespace {

// Calls use(lens) with the lens of any camera.
template <typename Use>
void with_lens(const Camera& camera, Use use) {
  if (camera.model == CameraModel::perspective)
    use(Lens(camera));
  else
    use(WideLens(camera));
}

void bind_response(py::module_& module) {
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
            if (array.ndim() != 1)
              throw py::value_error("curve must have shape (n,), got " + shape_of(array));
            return Response::from_curve({array.data(), array.data() + array.size()});
          },
          py::arg("curve"),
          "Linear values at evenly spaced encoded values, from 0 to 1: (n,) floats. 0 up to the "
          "black level and 1 from the white level on, strictly increasing between them; none, as "
          "`curve` tells of sRGB, for the sRGB curve. Raises ValueError for other values.")
      .def("between", &Response::between, py::arg("black"), py::arg("white"),
           "The same curve between other encoded levels, to an eighth of an 8-bit code: "
           "Response.srgb().between(16 / 255, 235 / 255) for video whose black is 16 and white "
           "235. Raises ValueError unless 0 <= black < white <= 1.")
      .def_property_readonly("black", &Response::black, "Encoded value of no light.")
      .def_property_readonly(
          "white", &Response::white,
          "Encoded value of the light at and beyond which everything is clipped.")
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
          "Linear float32 values of encoded ones in [0, 1], which may have any float dtype and "
          "shape.")
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
          "Encoded float32 values in [0, 1] of linear ones, which may have any float dtype and "
          "shape.")
      .def(py::self == py::self)
      .def("__repr__",
           [](const Response& r) {
             return r.curve.empty()
                        ? std::string("Response.srgb()")
                        : "<fastibl.Response of " + std::to_string(r.curve.size()) + " points>";
           })
      .def(py::pickle([](const Response& r) { return py::make_tuple(r.curve); },
                      [](const py::tuple& t) {
                        check(t.size() == 1, "the pickled state is no Response's");
                        return Response::from_curve(t[0].cast<std::vector<float>>());
                      }));
}

// Coefficients as OpenCV returns them: a row, a column, or plain numbers.
std::vector<double> opencv_distortion(const py::object& given) {
  const py::array any = require_array(given, "distortion");
  if (any.dtype().kind() != 'f' && any.dtype().kind() != 'i')
    throw py::type_error("distortion must hold numbers, got dtype " +
                         std::string(py::str(any.dtype())));
  const Doubles array = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(any);
  const bool vector =
      array.ndim() == 1 || (array.ndim() == 2 && (array.shape(0) == 1 || array.shape(1) == 1));
  if (!vector)
    throw py::value_error("distortion must have shape (n,), (1, n) or (n, 1), got " +
                          shape_of(array));
  return {array.data(), array.data() + array.size()};
}

void bind_making(py::class_<Camera>& camera_class) {
  camera_class
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
            Camera camera = Camera::equirectangular(width, height);
            camera.response = response.value_or(Response{}), camera.gain = gain;
            camera.validate();
            return camera;
          },
          py::arg("width"), py::arg("height"), py::arg("response") = py::none(),
          py::arg("gain") = 1.0,
          "A 360° camera that sees all directions, with z in the middle of the picture. width, "
          "height: pixels. Raises ValueError for a size below 1.")
      .def_static(
          "from_opencv",
          [](const py::object& K, const py::object& distortion, std::pair<int, int> size,
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
                                    k.at(1, 2), opencv_distortion(distortion), camera_model(model));
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
          "Makes a camera from OpenCV's camera matrix (3, 3), whose pixel centres are whole "
          "numbers. distortion: numbers, or an array (n,), (1, n) or (n, 1) as OpenCV returns it. "
          "size: (width, height). model: \"perspective\", or \"fisheye\" for a camera "
          "calibrated by cv2.fisheye. Raises ValueError for other shapes, a wrong number of "
          "coefficients or another model.");
}

void bind_fields(py::class_<Camera>& camera_class) {
  camera_class.def_readonly("width", &Camera::width, "Pixels.")
      .def_readonly("height", &Camera::height, "Pixels.")
      .def_readonly(
          "fx", &Camera::fx,
          "Focal length along x, pixels; for an equirectangular camera, pixels per radian.")
      .def_readonly("fy", &Camera::fy, "Focal length along y, as fx.")
      .def_readonly("cx", &Camera::cx, "Principal point along x, pixels, pixel centres at + 0.5.")
      .def_readonly("cy", &Camera::cy, "Principal point along y, as cx.")
      .def_property_readonly(
          "distortion", [](const Camera& c) { return py::tuple(py::cast(c.distortion)); },
          "k1 k2 p1 p2 [k3 [k4 k5 k6]]; for a fisheye k1 k2 k3 k4; empty for none.")
      .def_readonly("response", &Camera::response, "Response; sRGB by default.")
      .def_readonly("gain", &Camera::gain, "Factor on the exposure of all pictures.")
      .def_readonly("readout", &Camera::readout,
                    "Seconds from a picture's first row to its last; 0 for a global shutter.")
      .def_property_readonly(
          "model", [](const Camera& c) { return std::string(name(c.model)); },
          "\"perspective\", \"fisheye\" or \"equirectangular\".")
      .def_readonly("field_of_view", &Camera::field_of_view,
                    "Degrees across a fisheye's circle; 360 means all that its model reaches.")
      .def_property_readonly(
          "vignetting", [](const Camera& c) { return py::tuple(py::cast(c.vignetting)); },
          "v1, v2, ... of 1 + v1 r^2 + v2 r^4 + ..., r in focal lengths; empty for none.");
}

void bind_lens(py::class_<Camera>& camera_class) {
  camera_class
      .def_property_readonly(
          "opencv_matrix",
          [](const Camera& c) {
            Doubles k({3, 3});
            std::fill_n(k.mutable_data(), 9, 0.0);
            k.mutable_at(0, 0) = c.fx, k.mutable_at(1, 1) = c.fy, k.mutable_at(2, 2) = 1;
            k.mutable_at(0, 2) = c.cx - 0.5, k.mutable_at(1, 2) = c.cy - 0.5;
            return k;
          },
          "Camera matrix (3, 3) float64 in OpenCV's convention.")
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
          "Projects points (..., 3) in the camera frame to pixels (..., 2) float64; NaN behind a "
          "perspective camera and beyond the lens model.")
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
          "Directions (..., 3) float64 through pixels (..., 2): with z = 1 for a perspective "
          "camera, else of unit length; NaN beyond the lens model. Raises ValueError for another "
          "shape.");
}

void bind_value(py::class_<Camera>& camera_class) {
  camera_class.def(py::self == py::self)
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
}

void bind_rig(py::module_& module) {
  py::class_<Rig>(module, "Rig",
                  R"(A back camera, and a front camera fixed to it.

back: perspective Camera. front: Camera of any model, or None. front_from_back: Pose or (4, 4) float64 in metres, from
the back camera's frame to the front camera's. Raises ValueError if only one of front and front_from_back is given, or
for what is not a pose.)")
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

}  // namespace

void bind_camera(py::module_& module) {
  bind_response(module);
  py::class_<Camera> camera_class(
      module, "Camera",
      R"(A camera with one of OpenCV's lens models. Frame: x right, y down, z forward.

width, height: pixels.
fx, fy, cx, cy: pixels, pixel centres at (x + 0.5, y + 0.5) (see from_opencv).
distortion: k1 k2 p1 p2 [k3 [k4 k5 k6]].
response: Response, with encoded = response(exposure * gain * vignetting * radiance).
vignetting: v1, v2, ... of 1 + v1 r^2 + v2 r^4 + ..., r in units of the focal length.
readout: seconds from a picture's first row to its last: row r is exposed around time + r / height * readout.
model: "perspective"; "fisheye" (Kannala and Brandt 2006 as in OpenCV, distortion k1 k2 k3 k4 or none); or
"equirectangular" (longitude fx to the right and latitude fy downwards, pixels a radian; see equirectangular()).
The last two can only measure light, as a rig's front camera or in Capture: tracking boards and drawing objects need
perspective pictures.
field_of_view: degrees across a fisheye's circle; what lies outside it, black in most pictures, is ignored; 360 uses all
that the model reaches.
Raises ValueError for what is not a camera.)");
  bind_making(camera_class);
  bind_fields(camera_class);
  bind_lens(camera_class);
  bind_value(camera_class);
  bind_rig(module);
}

}  // namespace fastibl::bindings
