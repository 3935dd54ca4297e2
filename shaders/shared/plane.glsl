// The marker plane z = 0 and the shadow map on it.

// Where a ray that descends from the eye meets the plane.
FN vec2 plane_point(vec3 eye, vec3 ray) {
  float t = -eye.z / ray.z;
  return vec2(eye.x + t * ray.x, eye.y + t * ray.y);
}

// Position of a texel of the shadow map, in half edges from its centre.
FN float plane_offset(int i, float n) { return (float(i) + 0.5f - 0.5f * n) * 2.0f / n; }

// Share of the shadow that is kept: 1 inside, 0 at the border texels, smooth over the outer tenth.
FN float shadow_keep(vec2 p, float n) {
  float inwards = (abs(plane_offset(0, n)) - max(abs(p.x), abs(p.y))) / 0.1f;
  float t = clamp(inwards, 0.0f, 1.0f);
  return t * t * (3.0f - 2.0f * t);
}

// Alpha of a black that darkens what is behind it by these ratios: one alpha for three channels, by
// Rec. 709 luminance. It can only darken; light that the object adds to the plane is left out.
FN float shadow_alpha(vec3 ratio) {
  return max(1.0f - dot(ratio, vec3(0.2126f, 0.7152f, 0.0722f)), 0.0f);
}
