// What a GGX lobe reflects of a light, for C++ (through scene/shared_formulas.h, and eight at once in
// scene/ggx_kernel.inl) and GLSL ES 3.00. All vectors are in the frame of tangent, bitangent and normal; alpha is
// (alpha_x, alpha_y) along the first two. See shared/ggx.glsl for the lobe.

// |A w|
FN float ggx_size(vec3 w, vec2 alpha) {
  float x = alpha.x * w.x;
  float y = alpha.y * w.y;
  return sqrt(w.z * w.z + x * x + y * y);
}

// h × the x or the y axis, whichever is farther from h; times `part`.
FN vec3 any_across(vec3 h, float part) {
  float x = part * step(abs(h.x), 0.7f);
  float y = part - x;
  vec3 q = h;
  q.x = -h.z * y;
  q.y = h.z * x;
  q.z = h.x * y - h.y * x;
  return q;
}

// The lobe D G2 / (4 n·v) towards l, averaged over a round light of this variance (radians², along each axis) around l.
// view_size: |A v|.
// Slopes divided by alpha are stereographic coordinates: areas on the sphere have the density of GGX's r there. So the
// average over a disc of squared radius R² with its middle at r is that over a cap, 2/(π w (w + k)), with k = 1 + r² −
// R², w² = k² + 4 R².
// In slopes a light has half its radius in the plane of v and l, and half of it over v·h across that plane (the
// Jacobian of reflection). It is taken as a disc of the shorter axis, and the lobe is widened along the longer one. R²
// is such that the middle of the lobe is exact.
FN float ggx_light(vec3 v, vec2 alpha, float view_size, vec3 l, float variance) {
  vec3 h = l + v;
  h.z = h.z + 1e-6f;
  h = normalize(h);
  float hz = max(h.z, 1e-3f);
  float vh = max(dot(v, h), 5e-2f);
  // The direction across the plane of v and l; any direction if there is no plane. Without a branch, for loops over
  // lights.
  vec3 q = cross(v, l);
  q = q + any_across(h, step(dot(q, q), 1e-10f));
  q = q * (1.0f / sqrt(max(dot(q, q), 1e-20f)));
  vec3 p = cross(q, h);
  float qx = q.x / vh;
  float qy = q.y / vh;
  float ax = alpha.x * alpha.x;
  float ay = alpha.y * alpha.y;
  float xx = variance * (p.x * p.x + qx * qx);
  float yy = variance * (p.y * p.y + qy * qy);
  float xy = variance * (p.x * p.y + qx * qy);
  // Squares of the light's axes divided by those of the lobe's.
  float sum = 0.5f * (xx / ax + yy / ay);
  float product = max(xx * yy - xy * xy, 0.0f) / (ax * ay);
  float longer = sum + sqrt(max(sum * sum - product, 0.0f));
  float shorter = product / max(longer, 1e-20f);
  float wider = 1.0f + longer - shorter;
  float radius2 = sqrt((1.0f + longer) * (1.0f + shorter) / wider) - 1.0f;
  xx = ax + (xx - shorter * ax);
  yy = ay + (yy - shorter * ay);
  float det = ax * ay * wider;
  float sx = h.x / hz;
  float sy = h.y / hz;
  float k = 1.0f - radius2 + (yy * sx * sx - 2.0f * xy * sx * sy + xx * sy * sy) / det;
  float w = sqrt(k * k + 4.0f * radius2);
  float d = 2.0f / (3.14159265f * sqrt(det) * w * (w + k) * hz * hz * hz * hz);
  float up = max(l.z, 0.0f);
  return d * 0.5f * up / max(v.z * ggx_size(l, alpha) + up * view_size, 1e-12f);
}

// (1 − v·h)^5 for unit vectors, with h half-way from v to l. Never quite 0 or 1, so that an average with each weight
// exists.
FN float ggx_edge(vec3 l, vec3 v) {
  float x = 1.0f - sqrt(clamp(0.5f + 0.5f * dot(l, v), 0.0f, 1.0f));
  float x2 = x * x;
  return 1e-6f + (1.0f - 2e-6f) * x2 * x2 * x;
}
