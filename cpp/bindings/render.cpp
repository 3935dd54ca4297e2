#include <pybind11/operators.h>
#include <pybind11/stl.h>

#include "bindings/costs.h"
#include "bindings/detector.h"
#include "bindings/numpy.h"
#include "bindings/one_at_a_time.h"
#include "bindings/room_box.h"
#include "fastibl/render/session.h"
#include "fastibl/shadow/mesh_shadow.h"
#ifdef FASTIBL_WITH_GL
#include "fastibl/render/gl/gl_renderer.h"
#endif

namespace fastibl::bindings {
namespace {

std::unique_ptr<Renderer> renderer_named(const std::string& backend) {
  if (backend == "cpu") return make_cpu_renderer();
#ifdef FASTIBL_WITH_GL
  if (backend == "gl") return make_gl_renderer();
#else
  if (backend == "gl")
    throw std::runtime_error(
        "this fastibl was built without its GL back end: FASTIBL_GL=ON pip install . builds it, "
        "with Debian's libepoxy-dev, libegl-dev, libgles2 and libgl1-mesa-dri");
#endif
  throw py::value_error("backend must be \"auto\", \"cpu\" or \"gl\", got \"" + backend + "\"");
}

// Runs f alone on the session, and on its capture, which Python sees as an object of its own.
template <typename F>
auto alone(Session& session, F&& f) {
  return one_at_a_time(&session, &session.capture(), std::forward<F>(f));
}

// What Python sees of a processed frame; its arrays are made when asked for.
struct Result {
  FrameResult frame;
  ShadowMap shadow;
  Plan plan;
};

void bind_layers(py::module_& module) {
  py::class_<ObjectLayer>(module, "ObjectLayer",
                          "The shaded object before it is laid over the picture.")
      .def_readonly("x", &ObjectLayer::x, "Column of the picture at which the layer begins.")
      .def_readonly("y", &ObjectLayer::y, "Row of the picture at which the layer begins.")
      .def_property_readonly(
          "rgba", [](const ObjectLayer& l) { return image_array(l.rgba); },
          "(h, w, 4) float32: linear radiance times coverage, and coverage, starting at pixel (x, "
          "y).")
      .def(py::pickle(
          [](const ObjectLayer& l) { return py::make_tuple(l.x, l.y, image_array(l.rgba)); },
          [](const py::tuple& t) {
            return ObjectLayer{t[0].cast<int>(), t[1].cast<int>(), image_from(t[2], 4)};
          }));

  py::class_<PictureLayers>(
      module, "PictureLayers",
      R"(The layers from which a picture is composed, for a compositing program.

Linear light, where 1 is the white of the camera's response: back picture * ratio * (1 - object's alpha) + object is the
picture, before it is encoded and clipped.)")
      .def_property_readonly(
          "object", [](const PictureLayers& l) { return image_array(l.object); },
          "(h, w, 4) float32: the object as the camera takes it (exposure, gain, vignetting) times "
          "coverage, and coverage: premultiplied alpha.")
      .def_property_readonly(
          "ratio", [](const PictureLayers& l) { return image_array(l.ratio); },
          "(h, w, 3) float32: factor on the back picture, 1 where nothing changes it, above 1 "
          "where the object sends light to the plane.")
      .def(py::pickle(
          [](const PictureLayers& l) {
            return py::make_tuple(image_array(l.object), image_array(l.ratio));
          },
          [](const py::tuple& t) {
            return PictureLayers{image_from(t[0], 4), image_from(t[1], 3)};
          }));
}

void bind_result(py::module_& module) {
  py::class_<Result>(module, "FrameResult", "The result of a Session for one frame.")
      .def_property_readonly(
          "image", [](const Result& r) { return image_array(r.frame.image); },
          "(h, w, 3) uint8 encoded RGB; (h, w, 4) with straight alpha where the frame had no back "
          "picture. Where the board is not seen, or the view meets nothing of the scene, it is the "
          "back picture alone; without one, transparent.")
      .def_property_readonly(
          "back_from_marker", [](const Result& r) { return r.frame.back_from_marker; },
          "Pose, or None where the board is not seen. For a "
          "rolling shutter, it is the pose of the first row; the object is drawn with the pose of "
          "the row that shows its middle.")
      .def_property_readonly(
          "back_last_row", [](const Result& r) { return r.frame.back_last_row; },
          "Pose when the back camera's last row was taken; None for a global shutter, and where "
          "the motion is not known.")
      .def_property_readonly(
          "tracked", [](const Result& r) { return r.frame.tracked; },
          "Tracked, or None where the pose was given or the board is not seen.")
      .def_property_readonly(
          "turned", [](const Result& r) { return r.frame.turned; },
          "Turned, where the board is out of view and the surroundings tell how the cameras "
          "turned; with it the map may be captured, but nothing is drawn. Else None.")
      .def_property_readonly(
          "board_moved", [](const Result& r) { return r.frame.board_moved; },
          "True in the frame in which it became clear that the board was turned by hand; the map "
          "was then turned to match the board.")
      .def_property_readonly(
          "back_taken", [](const Result& r) { return r.frame.back_taken; },
          "Taken: how the back picture was used for the map; None where it was not.")
      .def_property_readonly(
          "front_taken", [](const Result& r) { return r.frame.front_taken; },
          "Taken: how the front picture was used for the map; None where it was not.")
      .def_property_readonly(
          "environment",
          [](const Result& r) { return std::const_pointer_cast<Environment>(r.frame.environment); },
          "Environment by which the frame was lit, or None before there is any.")
      .def_property_readonly("_lighting",
                             [](const Result& r) -> py::object {
                               return r.frame.lighting ? py::cast(*r.frame.lighting) : py::none();
                             })
      .def_property_readonly(
          "shadow_map", [](const Result& r) { return r.shadow; },
          "ShadowMap of the frame. A frame that casts none, as nothing changed or nothing of the "
          "scene is in view, has the last one; its image is empty where no shadow was cast yet, or "
          "the shadow is switched off.")
      .def_property_readonly(
          "plan", [](const Result& r) { return r.plan; }, "The Plan by which the frame was made.")
      .def_property_readonly(
          "passes",
          [](const Result& r) {
            std::vector<std::string> names;
            for (const PassId id : r.frame.passes) names.emplace_back(name(id));
            return names;
          },
          "Names of the passes that ran, in order. While the view meets neither the object, nor a "
          "real one, nor a place that the shadow can reach, they make nothing but light.")
      .def_property_readonly(
          "timings", [](const Result& r) { return r.frame.timings; },
          "Seconds by pass, and in total.")
      .def_property_readonly(
          "predicted_error", [](const Result& r) { return r.frame.predicted_error; },
          "Expected relative error of the irradiance.");
}

void bind_making(py::class_<Session>& session_class) {
  session_class.def(
      py::init([](const Scene& scene, const Rig& rig, const std::optional<Board>& board,
                  const std::shared_ptr<Environment>& environment, const py::object& detector,
                  const std::string& backend, const Methods& methods, double error,
                  double milliseconds, int size, bool cast_shadow, std::optional<double> distance,
                  const std::optional<RoomCorners>& box, double box_yaw, bool doubt_exposures,
                  const std::array<double, 3>& front_ratio, bool follow_surroundings,
                  const CubeMap* prior, double paper_albedo, std::optional<double> most_boost,
                  bool adapt, const std::map<std::string, double>& costs, bool offline,
                  int supersampling) {
        Detector function;
        if (!detector.is_none()) function = make_detector(detector);
        std::unique_ptr<Renderer> renderer = renderer_named(backend);
        return std::make_unique<Session>(
            scene, rig, board, environment, std::move(function), std::move(renderer),
            SessionOptions{.methods = methods,
                           .error = error,
                           .milliseconds = milliseconds,
                           .map_size = size,
                           .cast_shadow = cast_shadow,
                           .distance = distance,
                           .box = room_box(box, box_yaw),
                           .doubt_exposures = doubt_exposures,
                           .front_ratio = {front_ratio[0], front_ratio[1], front_ratio[2]},
                           .follow_surroundings = follow_surroundings,
                           .prior = prior ? std::make_shared<const CubeMap>(*prior) : nullptr,
                           .paper_albedo = paper_albedo,
                           .most_boost = most_boost,
                           .adapt = adapt,
                           .costs = costs_from(costs),
                           .offline = offline,
                           .supersampling = supersampling});
      }),
      py::arg("scene"), py::arg("rig"), py::arg("board"), py::arg("environment"),
      py::arg("detector"), py::arg("backend"), py::arg("methods"), py::arg("error"),
      py::arg("milliseconds"), py::arg("size"), py::arg("cast_shadow"), py::arg("distance"),
      py::arg("box"), py::arg("box_yaw"), py::arg("doubt_exposures"), py::arg("front_ratio"),
      py::arg("follow_surroundings"), py::arg("prior"), py::arg("paper_albedo"),
      py::arg("most_boost"), py::arg("adapt"), py::arg("costs"), py::arg("offline"),
      py::arg("supersampling"));
}

void bind_process(py::class_<Session>& session_class) {
  session_class.def(
      "_process",
      [](Session& session, double time, const py::object& back, const py::object& front,
         const std::optional<double>& back_exposure, const std::optional<double>& front_exposure,
         const py::object& back_from_marker, const py::object& back_last_row,
         const py::object& attitude) {
        py::array keep_back, keep_front;
        Frame frame;
        frame.time = time, frame.back_exposure = back_exposure,
        frame.front_exposure = front_exposure;
        if (!back.is_none()) frame.back = require_picture(back, "back", keep_back);
        if (!front.is_none()) frame.front = require_picture(front, "front", keep_front);
        if (!back_from_marker.is_none())
          frame.back_from_marker = require_pose(back_from_marker, "back_from_marker");
        if (!back_last_row.is_none())
          frame.back_last_row = require_pose(back_last_row, "back_last_row");
        if (!attitude.is_none()) frame.attitude = require_rotation(attitude, "a frame's attitude");
        return alone(session, [&] {
          Result result{session.process(frame), {}, session.plan()};
          result.shadow = session.shadow_map();
          return result;
        });
      },
      py::arg("time"), py::arg("back"), py::arg("front"), py::arg("back_exposure"),
      py::arg("front_exposure"), py::arg("back_from_marker"), py::arg("back_last_row") = py::none(),
      py::arg("attitude") = py::none());
}

void bind_products(py::class_<Session>& session_class) {
  session_class
      .def_property_readonly(
          "plan", [](Session& s) { return alone(s, [&] { return Plan(s.plan()); }); },
          "Plan of the next frame, as it stands now; print it to see the costs.")
      .def_property_readonly(
          "scene", [](Session& s) { return alone(s, [&] { return Scene(s.scene()); }); },
          "A copy of the Scene that is drawn: changes to it do not change the session.")
      .def_property_readonly(
          "shadow_map", [](Session& s) { return alone(s, [&] { return s.shadow_map(); }); },
          "ShadowMap of the last frame, see FrameResult.shadow_map.")
      .def_property_readonly(
          "plane_gain", [](Session& s) { return alone(s, [&] { return s.plane_gain(); }); },
          R"(ShadowMap by which the plane's picture was multiplied in the last frame that drew the scene.

Its ratio is the shadow's, changed by shadow strength and colour, plus the light that the object sends to the plane
relative to what the plane gets without the object: it may exceed 1.)")
      .def_property_readonly(
          "object", [](Session& s) { return alone(s, [&] { return s.object(); }); },
          "ObjectLayer of the last frame; empty where nothing was drawn.")
      .def_property_readonly(
          "holdout", [](Session& s) { return alone(s, [&] { return s.holdout(); }); },
          "ObjectLayer of the real objects in front of the virtual one in the last frame: the "
          "share of their light that is left times coverage, and coverage.")
      .def_property_readonly(
          "layers", [](Session& s) { return alone(s, [&] { return s.layers(); }); },
          R"(PictureLayers of the last frame: the layers from which its picture was composed, as floats.

Also after anything was set; another scene or back end leaves none.

Without the board or anything of the scene in view nothing covers the picture, and the ratio is 1.)")
      .def_property_readonly("capture", &Session::capture,
                             py::return_value_policy::reference_internal,
                             "The Capture that receives the pictures.")
      .def_property_readonly(
          "backend", [](Session& s) { return std::string(s.renderer().backend()); },
          "\"cpu\" or \"gl\".")
      .def_property_readonly(
          "device", [](Session& s) { return s.renderer().device(); },
          "The driver's name for the device that draws (GL_RENDERER): a graphics card, or "
          "\"llvmpipe …\" where Mesa draws in software; \"\" on the CPU back end.");
}

void bind_changes(py::class_<Session>& session_class) {
  session_class
      .def(
          "set_shadow_look",
          [](Session& s, double strength, const py::object& color) {
            const ShadowLook look{float(strength), require_triple(color, "color")};
            alone(s, [&] { s.set_shadow_look(look); });
          },
          py::arg("strength") = 1.0, py::arg("color") = py::make_tuple(0.0, 0.0, 0.0),
          "Draw the shadow with this strength and colour from the next frame on, see "
          "Scene.shadow_strength and shadow_color. Raises ValueError for values outside [0, 1].")
      .def(
          "set_material",
          [](Session& s, const Material& material) { alone(s, [&] { s.set_material(material); }); },
          py::arg("material"), "Use another material from the next frame on.")
      .def(
          "move",
          [](Session& s, const py::object& pose) {
            const Pose marker_from_object = require_pose(pose, "marker_from_object");
            alone(s, [&] { s.move(marker_from_object); });
          },
          py::arg("marker_from_object"),
          "Move the object: Pose or (4, 4) float64, metres. Raises ValueError for what is not a "
          "pose.")
      .def(
          "restart_clock", [](Session& s) { alone(s, [&] { s.restart_clock(); }); },
          "Let the next frame have any time: a camera's clock was set, or one frame had a wrong "
          "time. The map is kept; what was captured counts as a second older.")
      .def(
          "_set_cast_shadow",
          [](Session& s, bool cast) { alone(s, [&] { s.set_cast_shadow(cast); }); },
          py::arg("cast"))
      .def(
          "_set_baked_shadow",
          [](Session& s, const std::shared_ptr<MeshShadow>& baked) {
            alone(s, [&] { s.set_baked_shadow(baked); });
          },
          py::arg("baked"))
      .def(
          "_set_environment",
          [](Session& s, const std::shared_ptr<Environment>& e) {
            alone(s, [&] { s.set_environment(e); });
          },
          py::arg("environment"))
      .def(
          "_set_methods",
          [](Session& s, const Methods& methods) { alone(s, [&] { s.set_methods(methods); }); },
          py::arg("methods"))
      .def(
          "_set_scene",
          [](Session& s, const Scene& scene) { alone(s, [&] { s.set_scene(scene); }); },
          py::arg("scene"))
      .def(
          "set_budgets",
          [](Session& s, double error, double milliseconds) {
            alone(s, [&] { s.set_budgets(error, milliseconds); });
          },
          py::arg("error") = 0.0, py::arg("milliseconds") = 0.0,
          "Keep to other budgets from the next frame on; 0 means no budget. Raises ValueError for "
          "values that are negative or not finite.")
      .def(
          "_set_backend",
          [](Session& s, const std::string& backend) {
            auto renderer = renderer_named(backend);
            alone(s, [&] { s.set_renderer(std::move(renderer)); });
          },
          py::arg("backend"));
}

}  // namespace

void bind_render(py::module_& module) {
  bind_layers(module);
  bind_result(module);
  py::class_<Session> session_class(module, "_Session");
  bind_making(session_class);
  bind_process(session_class);
  bind_products(session_class);
  bind_changes(session_class);
}

}  // namespace fastibl::bindings
