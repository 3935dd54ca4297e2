// Sphere sets from NumPy.
#pragma once

#include "bindings/numpy.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl::bindings {

// (m, 4) of any float dtype: centre, radius.
inline SphereSet require_spheres(const py::object& object) {
  const Floats array = require_floats<float>(object, "spheres");
  if (array.ndim() != 2 || array.shape(1) != 4)
    throw py::value_error("spheres must have shape (m, 4), got " + shape_of(array));
  SphereSet spheres;
  for (const float* s = array.data(); s < array.data() + array.size(); s += 4)
    spheres.push_back({s[0], s[1], s[2], s[3]});
  return spheres;
}

}  // namespace fastibl::bindings
