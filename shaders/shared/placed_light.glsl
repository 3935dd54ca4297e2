// Near lights as they are seen from places beside the map's centre. A light at centre + direction / rho is seen along
// direction - rho (place - centre); the length of that is the light's distance divided by its distance from the centre.
// rho = 0 is a distant light.

// A vector towards the light; its length is the light's distance divided by that from the centre.
FN vec3 near_arrow(vec3 direction, float rho, vec3 offset) { return direction - rho * offset; }

// A light of the glossy chain seen from such a place. Its radiance summed over its solid angle grows by `gain`, and so
// does its variance (along each axis, radians squared), but to no more than that of a light all around.
struct PlacedLight {
  vec3 direction;
  float variance;
  float gain;
};
FN PlacedLight placed_light(vec3 direction, float rho, float variance, vec3 offset) {
  PlacedLight light;
  vec3 arrow = near_arrow(direction, rho, offset);
  light.gain = min(1.0f / max(dot(arrow, arrow), 1e-12f), max(1.0f / variance, 1.0f));
  light.direction = arrow * (1.0f / sqrt(max(dot(arrow, arrow), 1e-12f)));
  light.variance = variance * light.gain;
  return light;
}
