#include "bindings/module.h"

#include <exception>

#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#endif

#include "bindings/argument_errors.h"
#include "bindings/one_at_a_time.h"
#include "bindings/pickles.h"

PYBIND11_MODULE(_fastibl, module) {
  using namespace fastibl::bindings;
  namespace py = pybind11;
  module.doc() = "fastibl's C++ core. Import fastibl instead.";
  module.attr("__version__") = FASTIBL_VERSION;
#if defined(__unix__) || defined(__APPLE__)
  pthread_atfork(nullptr, nullptr, free_mutexes);
#endif
  // The argument is of another type: without this, pybind11 makes it a RuntimeError.
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const py::cast_error& error) {
      py::set_error(PyExc_TypeError, error.what());
    }
  });
  bind_core(module);
  bind_cube(module);
  bind_camera(module);
  bind_board(module);
  bind_mesh(module);
  bind_environment(module);
  bind_material(module);
  bind_lighting(module);
  bind_ggx(module);
  bind_prefilter(module);
  bind_capture(module);
  bind_shadow(module);
  bind_mesh_shadow(module);
  bind_object(module);
  bind_plane_exchange(module);
  bind_shading(module);
  bind_tracking(module);
  bind_rotation_tracker(module);
  bind_methods(module);
  bind_plan(module);
  bind_render(module);
#ifdef FASTIBL_WITH_GL
  module.attr("with_gl") = true;
#else
  module.attr("with_gl") = false;
#endif
  refuse_old_pickles(module);
  explain_argument_errors(module);
}
