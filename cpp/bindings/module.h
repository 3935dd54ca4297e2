// The parts of the module; each is bound in the file of its name.
#pragma once

#include <pybind11/pybind11.h>

namespace fastibl::bindings {

void bind_core(pybind11::module_& module);
void bind_material(pybind11::module_& module);
void bind_cube(pybind11::module_& module);
void bind_camera(pybind11::module_& module);
void bind_board(pybind11::module_& module);
void bind_mesh(pybind11::module_& module);
void bind_environment(pybind11::module_& module);
void bind_tracking(pybind11::module_& module);
void bind_rotation_tracker(pybind11::module_& module);
void bind_capture(pybind11::module_& module);
void bind_lighting(pybind11::module_& module);
void bind_ggx(pybind11::module_& module);
void bind_prefilter(pybind11::module_& module);
void bind_shadow(pybind11::module_& module);
void bind_mesh_shadow(pybind11::module_& module);
void bind_object(pybind11::module_& module);
void bind_plane_exchange(pybind11::module_& module);
void bind_shading(pybind11::module_& module);
void bind_methods(pybind11::module_& module);
void bind_plan(pybind11::module_& module);
void bind_render(pybind11::module_& module);

}  // namespace fastibl::bindings
