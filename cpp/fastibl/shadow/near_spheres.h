// The shadow of spheres on the plane z = 0 by a light that is near: what the cones of tangents from
// the light cut out of it.
#pragma once

#include "fastibl/shadow/plane_bits.h"

namespace fastibl {

// Sets the texels of a grid whose centre lies in a sphere, or does not see the light for one; bits
// that are set stay set. light: a point, metres, z > 0. Spheres as those of PlaneSpheres.
void add_near_shadow(const SphereSet& spheres, const glm::dvec3& light, const PlaneGrid& grid,
                     PlaneBits& bits);

}  // namespace fastibl
