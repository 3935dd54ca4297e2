// Near things: irradiance by lights of shared/placed_light.glsl, and walls. Needs shared/sphere_cap.glsl.

// Irradiance on a surface with normal n by a sphere of even radiance, of which the surface may see a part only; divided
// by what a surface that faces the sphere at the map's centre gets. sin_radius: sine of the sphere's angular radius
// there, above 0. Inside the sphere the arrow is shorter than that: its radiance comes from half of all directions.
FN float near_irradiance(vec3 arrow, float sin_radius, vec3 n) {
  float length2 = max(dot(arrow, arrow), 1e-12f);
  float own2 = sin_radius * sin_radius;
  float sin2 = min(own2 / length2, 1.0f);
  float cosine = dot(n, arrow) / sqrt(length2);
  return cap_projected_solid_angle(cosine, sin2, 1.0f - sin2) / (3.14159265f * own2);
}

// A vector along the axes of a box that is turned about z. axis: cosine and sine of the angle.
FN vec3 along_walls(vec3 v, vec2 axis) {
  return vec3(axis.x * v.x + axis.y * v.y, axis.x * v.y - axis.y * v.x, v.z);
}
FN float wall_distance(float d, float lower, float upper, float offset) {
  float wall = (d > 0.0f ? upper : lower) - offset;
  return abs(d) > 1e-6f ? wall / d : 1e6f;
}
// The direction from the centre of a box to the point that a ray d from a place in the box meets; the place and the
// corners are given relative to its centre, the corners along its own axes. The result is d if the place is outside.
FN vec3 box_direction(vec3 d, vec3 offset, vec3 lower, vec3 upper, vec2 axis) {
  vec3 ray = along_walls(d, axis), from = along_walls(offset, axis);
  float t = min(min(wall_distance(ray.x, lower.x, upper.x, from.x), wall_distance(ray.y, lower.y, upper.y, from.y)),
                wall_distance(ray.z, lower.z, upper.z, from.z));
  return t > 0.0f ? offset + t * d : d;
}
