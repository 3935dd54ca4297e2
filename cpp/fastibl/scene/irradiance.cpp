#include "fastibl/scene/irradiance.h"

#include "fastibl/core/check.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {

glm::vec3 evaluate(const Irradiance& e, glm::vec3 n) {
  switch (e.method) {
    case DiffuseMethod::nearest_face:
      return kPi * e.faces[std::size_t(shared::nearest_face(n))];
    case DiffuseMethod::six_face:
      return shared::six_face_irradiance(e.faces.data(), n);
    case DiffuseMethod::six_face_exact:
      return shared::exact_face_irradiance(e.faces.data(), glm::dvec3(n));
    case DiffuseMethod::sh9_lobes:
      return shared::lobes_irradiance(e.polynomial.data(), e.lobes.axes.data(), e.lobes.counts[0],
                                      e.lobes.count(), e.lobes.colours.data(), n);
    case DiffuseMethod::irradiance_cube:
      check(e.cube != nullptr, "an irradiance cube that was not made cannot be looked up");
      return e.cube->sample(n);
    default:
      return shared::sh9_irradiance(e.polynomial.data(), n);
  }
}

}  // namespace fastibl
