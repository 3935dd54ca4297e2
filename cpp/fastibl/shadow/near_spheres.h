// The shadow of spheres on the plane z = 0 by a near light: the part of the plane that the tangent
// cones from the light cut out.
#pragma once

#include "fastibl/shadow/plane_bits.h"

namespace fastibl {

// Sets the texels of a grid whose centre lies in a sphere, or from which a sphere hides the light;
// bits that are set stay set. light: a point, metres, z > 0. Spheres as those of PlaneSpheres.
void add_near_shadow(const SphereSet& spheres, const glm::dvec3& light, const PlaneGrid& grid,
                     PlaneBits& bits);

}  // namespace fastibl
