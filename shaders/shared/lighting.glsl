// Lighting formulas that C++ (through scene/shared_formulas.h) and GLSL ES 3.00 both compile.

// Share of the irradiance that a face of the cube gives, by the angle between normal and face axis:
// Croubois et al. 2014, Eq. 9. Its six values sum to 0.966–0.978 π.
FN float face_weight(float cos_theta) {
  float t = max(0.75f + cos_theta, 0.0f);
  return t * t / 1.75f;
}

// Contribution of the edge from a to b to Lambert's formula for the irradiance of a polygon.
FN REAL polygon_edge(REAL3 a, REAL3 b, REAL3 n) {
  REAL3 c = cross(a, b);
  REAL l = length(c);
  return l > REAL(1e-12f) ? atan(l, dot(a, b)) / l * dot(c, n) : REAL(0.0f);
}

// W_F of Eq. 7 in closed form: the face's square, clipped at the horizon of n, by Lambert's formula.
// n: unit normal in the face's own frame, along its s and t axes and its major axis. Six faces sum to π.
FN REAL exact_face_weight(REAL3 n) {
  REAL3 corner[4];
  corner[0] = REAL3(-1.0f, -1.0f, 1.0f);
  corner[1] = REAL3(1.0f, -1.0f, 1.0f);
  corner[2] = REAL3(1.0f, 1.0f, 1.0f);
  corner[3] = REAL3(-1.0f, 1.0f, 1.0f);
  REAL sum = REAL(0.0f);
  REAL3 leaving = REAL3(0.0f);   // where the outline goes below the horizon,
  REAL3 entering = REAL3(0.0f);  // and where it comes back
  for (int i = 0; i < 4; ++i) {
    REAL3 a = corner[i];
    REAL3 b = corner[(i + 1) % 4];
    REAL da = dot(a, n);
    REAL db = dot(b, n);
    if (da > REAL(0.0f) && db > REAL(0.0f)) {
      sum += polygon_edge(a, b, n);
    } else if (da > REAL(0.0f)) {
      leaving = a + (b - a) * (da / (da - db));
      sum += polygon_edge(a, leaving, n);
    } else if (db > REAL(0.0f)) {
      entering = a + (b - a) * (da / (da - db));
      sum += polygon_edge(entering, b, n);
    }
  }
  sum += polygon_edge(leaving, entering, n);
  return max(sum * REAL(0.5f), REAL(0.0f));
}

// MIP level whose texels are as wide as the lobe of half-vector exponent s: Eq. 2, logarithm base 2,
// clamped to the chain. face_size: texels of level 0.
FN float mip_level(float face_size, float exponent) {
  float top = log2(face_size);
  float level = log2(face_size * 1.7320508f) - 0.5f * log2(exponent + 1.0f);
  return clamp(level, 0.0f, top);
}

// Where the table of the directional albedo is read, in [0, 1]: 1 at s = 0, 0 at s = ∞.
FN float albedo_coordinate(float exponent) { return 1.0f / sqrt(1.0f + exponent / 8.0f); }

// Face that a direction meets: +x -x +y -y +z -z.
FN int nearest_face(vec3 d) {
  vec3 a = abs(d);
  if (a.x >= a.y && a.x >= a.z) return d.x > 0.0f ? 0 : 1;
  if (a.y >= a.z) return d.y > 0.0f ? 2 : 3;
  return d.z > 0.0f ? 4 : 5;
}

// Irradiance by Eq. 8 from the mean radiance of each face, with the weights of Eq. 9.
FN vec3 six_face_irradiance(const vec3 face[6], vec3 n) {
  vec3 sum = face_weight(n.x) * face[0];
  sum += face_weight(-n.x) * face[1];
  sum += face_weight(n.y) * face[2];
  sum += face_weight(-n.y) * face[3];
  sum += face_weight(n.z) * face[4];
  sum += face_weight(-n.z) * face[5];
  return sum;
}

// The same with the exact weights, which take n along the s, t and major axes of each face.
FN vec3 exact_face_irradiance(const vec3 face[6], REAL3 n) {
  vec3 sum = float(exact_face_weight(REAL3(-n.z, -n.y, n.x))) * face[0];
  sum += float(exact_face_weight(REAL3(n.z, -n.y, -n.x))) * face[1];
  sum += float(exact_face_weight(REAL3(n.x, n.z, n.y))) * face[2];
  sum += float(exact_face_weight(REAL3(n.x, -n.z, -n.y))) * face[3];
  sum += float(exact_face_weight(REAL3(n.x, -n.y, n.z))) * face[4];
  sum += float(exact_face_weight(REAL3(-n.x, -n.y, -n.z))) * face[5];
  return sum;
}

// Irradiance from nine spherical harmonics in polynomial form.
FN vec3 sh9_polynomial(const vec3 c[9], vec3 n) {
  return c[0] + c[1] * n.y + c[2] * n.z + c[3] * n.x + c[4] * (n.x * n.y) + c[5] * (n.y * n.z) +
         c[6] * (3.0f * n.z * n.z - 1.0f) + c[7] * (n.x * n.z) + c[8] * (n.x * n.x - n.y * n.y);
}

// Never negative: the ringing of a small bright light would dip below 0 on the far side.
FN vec3 sh9_irradiance(const vec3 c[9], vec3 n) { return max(sh9_polynomial(c, n), 0.0f); }

// The same with lights added as lobes of two colours; the first `first` lobes have the first colour.
FN vec3 lobes_irradiance(const vec3 c[9], const vec3 axes[12], int first, int count,
                         const vec3 colours[2], vec3 n) {
  float one = 0.0f;
  float other = 0.0f;
  for (int k = 0; k < first; ++k) one += max(dot(n, axes[k]), 0.0f);
  for (int k = first; k < count; ++k) other += max(dot(n, axes[k]), 0.0f);
  return max(sh9_polynomial(c, n) + one * colours[0] + other * colours[1], 0.0f);
}

// Unit tangent along the plane of incidence. If the view is along the normal, it is any tangent that does not jump at a
// cube's edge.
FN vec3 incidence_tangent(vec3 n, vec3 v) {
  const vec3 axis = vec3(0.36f, 0.48f, 0.8f);
  vec3 t = v - dot(v, n) * n + 1e-5f * (axis - dot(axis, n) * n);
  float size = length(t);
  return size > 1e-12f ? t / size : vec3(0.8f, -0.6f, 0.0f);
}

// To what degree taps much finer than a texel read that texel alone: 0 for lobes narrower than texels, which blend
// between texels as a mirror does.
FN float sampled_texel_share(float exponent, float face_size) {
  float texels = 2.0f / sqrt(exponent + 1.0f) * face_size / 1.57079633f;  // the lobe's deviation
  return clamp(2.0f * texels - 1.0f, 0.0f, 1.0f);
}

// Standard deviation of level 0 of the chain of round lobes, along each axis in radians: a texel of the map that is
// read bilinearly has half its width.
FN float own_lobe_width(float face_size) {
  return min(0.78539816f / face_size, 0.5f * 0.022097087f);
}

// Level whose lobe has this standard deviation; that of level 1, 2/sqrt(8192), is GlossyChain's
// kFinestWidth.
FN float lobe_level(float width, float face_size) {
  const float finest = 0.022097087f;
  if (width >= finest) return min(1.0f + log2(width / finest), 7.0f);
  float own = own_lobe_width(face_size);
  return width > own ? log2(width / own) / log2(finest / own) : 0.0f;
}
