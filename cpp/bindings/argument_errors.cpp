#include "bindings/argument_errors.h"

#include <string>

namespace py = pybind11;

namespace fastibl::bindings {
namespace {

using Entry = PyObject* (*)(PyObject* self, PyObject* const* args, Py_ssize_t count,
                            PyObject* names);

Entry dispatch = nullptr;  // pybind11's own entry, one for all functions of a module

// If the error that is set is pybind11's about arguments that do not fit, fastibl's Python side
// words one in its place.
void explain(PyObject* const* args, Py_ssize_t count, PyObject* names) {
  py::error_already_set error;  // takes over the error that is set
  const std::string message = py::str(error.value());
  if (message.find("The following argument types are supported") == message.npos)
    return error.restore();
  try {
    py::list by_place;
    for (Py_ssize_t i = 0; i < count; ++i) by_place.append(py::handle(args[i]));
    py::dict by_name;
    if (names)
      for (const py::handle& name : py::reinterpret_borrow<py::tuple>(names))
        by_name[name] = py::handle(args[count++]);
    const py::object text = py::module_::import("fastibl.argument_errors")
                                .attr("explain")(message, py::tuple(by_place), by_name);
    PyErr_SetObject(PyExc_TypeError, text.ptr());
  } catch (py::error_already_set&) {
    error.restore();
  }
}

PyObject* call(PyObject* self, PyObject* const* args, Py_ssize_t count, PyObject* names) {
  PyObject* result = dispatch(self, args, count, names);
  if (!result && PyErr_ExceptionMatches(PyExc_TypeError)) explain(args, count, names);
  return result;
}

void replace_entry(const py::handle& object) {
  PyObject* function = object.ptr();
  if (PyInstanceMethod_Check(function)) function = PyInstanceMethod_GET_FUNCTION(function);
  if (!PyCFunction_Check(function)) return;
  PyMethodDef* method = reinterpret_cast<PyCFunctionObject*>(function)->m_ml;
  if (method->ml_flags != (METH_FASTCALL | METH_KEYWORDS)) return;
  using Any = void (*)();
  const auto entry = reinterpret_cast<Entry>(reinterpret_cast<Any>(method->ml_meth));
  if (!dispatch) dispatch = entry;
  if (entry == dispatch)
    method->ml_meth = reinterpret_cast<PyCFunction>(reinterpret_cast<Any>(&call));
}

// Replaces the entries of all that a module or a class holds.
void replace_entries(const py::handle& holder) {
  for (const auto& item : py::dict(holder.attr("__dict__"))) {
    const py::handle value = item.second;
    replace_entry(value);
    if (PyType_Check(value.ptr()) && PyModule_Check(holder.ptr())) replace_entries(value);
    for (const char* function : {"__func__", "fget", "fset"})  // static methods, properties
      if (py::hasattr(value, function)) replace_entry(value.attr(function));
  }
}

}  // namespace

void explain_argument_errors(const py::module_& module) { replace_entries(module); }

}  // namespace fastibl::bindings
