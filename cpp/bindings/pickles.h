// What pickling may do with classes of the extension.
#pragma once

#include <pybind11/pybind11.h>

namespace fastibl::bindings {

// Pickles of protocols 0 and 1 know no such classes: asked for one, pybind11 ends the process. They
// get a TypeError instead. Call it when all classes are there.
void refuse_old_pickles(const pybind11::module_& module);

}  // namespace fastibl::bindings
