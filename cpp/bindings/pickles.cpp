#include "bindings/pickles.h"

#include <pybind11/eval.h>

namespace fastibl::bindings {

namespace py = pybind11;

void refuse_old_pickles(const py::module_& module) {
  py::dict scope;
  py::exec(R"(
def reduce_ex(self, protocol):
    if protocol < 2:
        raise TypeError(f"a {type(self).__name__} is pickled by protocol 2 and later, got {protocol}")
    return object.__reduce_ex__(self, protocol)
)",
           scope);
  const py::object base = py::module_::import("builtins").attr("object");
  for (const auto& [name, member] : py::dict(module.attr("__dict__")))
    if (PyType_Check(member.ptr()) && member.attr("__reduce_ex__").is(base.attr("__reduce_ex__")))
      py::setattr(member, "__reduce_ex__", scope["reduce_ex"]);
}

}  // namespace fastibl::bindings
