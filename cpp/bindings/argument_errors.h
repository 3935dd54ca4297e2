// Replaces what pybind11 says about arguments that do not fit with a sentence about the one that
// does not.
#pragma once

#include <pybind11/pybind11.h>

namespace fastibl::bindings {

// Applies to all functions, constructors, methods and properties of the module. pybind11 answers
// with every signature that would fit and has no hook for its answer, so the entry of each function
// is replaced by one that asks fastibl.argument_errors once a call has failed. Call it last, when
// everything is bound.
void explain_argument_errors(const pybind11::module_& module);

}  // namespace fastibl::bindings
