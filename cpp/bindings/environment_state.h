// What is known about a place's light, as pickles hold it.
#pragma once

#include "bindings/numpy.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/main_lights.h"

namespace fastibl::bindings {

py::tuple environment_state(const Environment& environment);
Environment environment_from_state(const py::tuple& state);  // throws as Environment::validate()

py::tuple main_light_state(const MainLight& light);
MainLight main_light_from_state(const py::tuple& state);

}  // namespace fastibl::bindings
