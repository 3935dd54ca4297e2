// Progress of work, told to Python.
#pragma once

#include <pybind11/functional.h>

#include <functional>

#include "bindings/numpy.h"

namespace fastibl::bindings {

// Calls a function of Python's, if there is one, with the part that is done, and lets Ctrl-C
// through. To be called without the GIL.
inline bool tell_python(const std::function<bool(float)>& progress, float done) {
  const WithGil acquire;
  if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  return progress ? progress(done) : true;
}

// Progress of work that tells none: only lets Ctrl-C through.
inline bool let_signals_through(float done) { return tell_python({}, done); }

}  // namespace fastibl::bindings
