#include <pybind11/stl.h>

#include "bindings/numpy.h"
#include "bindings/progress.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/shading/holdout.h"
#include "fastibl/shadow/mesh_shadow.h"

namespace fastibl::bindings {
namespace {

// What fastibl.progress.reporting gives while it lives.
class Reporting {
 public:
  Reporting(const py::object& progress, const char* what)
      : manager_(py::module_::import("fastibl.progress").attr("reporting")(progress, what)),
        report_(py::cast<std::function<bool(float)>>(manager_.attr("__enter__")())) {}
  ~Reporting() {
    try {
      manager_.attr("__exit__")(py::none(), py::none(), py::none());
    } catch (py::error_already_set& error) {  // of a stream that is closed, perhaps
      error.discard_as_unraisable("the end of a progress bar");
    }
  }
  Reporting(const Reporting&) = delete;
  Reporting& operator=(const Reporting&) = delete;

  bool operator()(float done) const { return tell_python(report_, done); }

 private:
  py::object manager_;
  std::function<bool(float)> report_;
};

void set_look(Scene& scene, const ShadowLook& look) {
  look.validate();
  scene.shadow_look = look;
}

}  // namespace

void bind_object(py::module_& module) {
  py::class_<Scene>(module, "Scene", R"(An object ready to be rendered.

mesh: Mesh in its own frame, metres (see stand).
material: Material.
marker_from_object: Pose or (4, 4); the marker frame by default.
spheres: largest number of shadow proxies, 0 for no shadow.
visibility_rays: number of rays for P_V, 0 for no self-shadow at all.
refine: whether to split triangles in which the object's self-shadow changes; the surface stays the same, and so does
the paper's P_V.
progress: whether to show a bar on stderr if that is a terminal and the work takes long; or a function that is given the
part done, and ends the work with KeyboardInterrupt by returning False.
Raises ValueError for negative numbers or what is not a pose.)")
      .def(py::init([](const Mesh& mesh, const std::optional<Material>& material,
                       const py::object& marker_from_object, int spheres, int rays, bool refine,
                       const py::object& progress) {
             const Pose pose = marker_from_object.is_none()
                                   ? Pose{}
                                   : require_pose(marker_from_object, "marker_from_object");
             const Reporting reporting(progress, "make scene");
             SceneOptions options{spheres, rays};
             options.refine = refine;
             options.progress = [&](float done) { return reporting(done); };
             try {
               const WithoutGil release;
               return make_scene(mesh, material.value_or(Material{}), pose, options);
             } catch (const WorkEnded&) {
               PyErr_SetString(PyExc_KeyboardInterrupt, "making a scene was ended");
               throw py::error_already_set();
             }
           }),
           py::arg("mesh"), py::arg("material") = py::none(),
           py::arg("marker_from_object") = py::none(), py::arg("spheres") = 50,
           py::arg("visibility_rays") = 96, py::arg("refine") = true, py::arg("progress") = true)
      .def_property_readonly(
          "mesh", &Scene::given_mesh,
          "The mesh as it was given, counter-clockwise seen from outside. A mesh without normals "
          "that has edges sharper than 60 degrees gets normals, and copies of vertices after its "
          "own, so that such edges are drawn sharp.")
      .def_readonly("refined_mesh", &Scene::mesh,
                    "The surface that is shaded: that of `mesh`, with more vertices where the "
                    "object's self-shadow changes; equal to `mesh` where nothing had to be split.")
      .def_property(
          "material", [](const Scene& s) { return s.material; },
          [](Scene& s, const Material& material) {
            check_fits(material, s.mesh);
            s.material = material;
          },
          R"(Material of the object.

Setting another one takes no time, as what the mesh hides is kept; sessions that were made before keep theirs, see
Session.set_material. Raises ValueError for textures on a mesh without uvs.)")
      .def_readonly("marker_from_object", &Scene::marker_from_object,
                    "Pose: where the object stands.")
      .def_property_readonly(
          "visibility",
          [](const Scene& s) {
            return py::array_t<float>(py::ssize_t(s.given_mesh().vertices.size()),
                                      s.visibility.data());
          },
          "P_V at the vertices of mesh, (v,) float32.")
      .def_property_readonly(
          "spheres",
          [](const Scene& s) {
            Floats out({py::ssize_t(s.spheres.size()), py::ssize_t{4}});
            std::memcpy(out.mutable_data(), s.spheres.data(), s.spheres.size() * sizeof(glm::vec4));
            return out;
          },
          "(m, 4) float32: centre and radius, mesh frame.")
      .def_property(
          "baked_shadow",
          [](const Scene& s) { return std::const_pointer_cast<MeshShadow>(s.baked_shadow); },
          [](Scene& s, const py::object& given) {
            const py::object baked =
                py::hasattr(given, "baked") ? py::object(given.attr("baked")) : given;
            if (!baked.is_none() && !py::isinstance<MeshShadow>(baked))
              throw py::type_error("baked_shadow must be a MeshShadow or None, got " +
                                   type_name(baked));
            s.baked_shadow = baked.cast<std::shared_ptr<MeshShadow>>();
          },
          R"(How the mesh hides the sky, for the shadow method "mesh": None, or a MeshShadow of `mesh` that you set.

Without it that method raises ValueError. Where an object that has one is tilted or lifted off the plane, its triangles
are drawn for each direction of light instead, as the method "directions" draws its spheres.)")
      .def_property(
          "shadow_strength", [](const Scene& s) { return s.shadow_look.strength; },
          [](Scene& s, double strength) {
            set_look(s, {float(strength), s.shadow_look.color});
          },
          "How much of the shadow is drawn, from 0 (none) to 1 (as it falls, the default).")
      .def_property(
          "shadow_color", [](const Scene& s) { return triple(s.shadow_look.color); },
          [](Scene& s, const py::object& color) {
            set_look(s, {s.shadow_look.strength, require_triple(color, "shadow_color")});
          },
          "Linear RGB in [0, 1]: the part of the plane's light that is left where nothing lights "
          "it; black by default.")
      .def_property(
          "holdouts",
          [](const Scene& s) {
            return py::tuple(py::cast(s.holdouts ? s.holdouts->meshes : std::vector<Mesh>{}));
          },
          [](Scene& s, const std::vector<Mesh>& meshes) {
            const WithoutGil release;
            s.holdouts = make_holdouts(meshes, s);
          },
          R"(Real objects as meshes, marker frame: tuple of Mesh, empty by default; set from any sequence of them.

Where a real object is nearer than the virtual one, the back picture is kept, multiplied by the share of that surface's
light that the virtual object leaves. A mesh that is not closed is assumed to face the object. Set it before a Session
is made. Real objects do not shade the virtual object, nor keep its shadow from the plane behind them.)")
      .def("__reduce__",
           [](const Scene&) -> py::object {
             throw py::type_error(
                 "a Scene is not pickled; pickle its mesh and its material, and make Scene(...) of "
                 "them there");
           })
      .def("__repr__", [](const Scene& s) {
        return "<fastibl.Scene of " + std::to_string(s.given_mesh().triangles.size()) +
               " triangles, " + std::to_string(s.spheres.size()) + " spheres>";
      });
}

}  // namespace fastibl::bindings
