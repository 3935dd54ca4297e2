// Glossy lobes (n·h)^s max(n·l, 0), for C++ (through scene/shared_formulas.h) and GLSL ES 3.00.

// e^{-x} for x in [0, 32], below 1e-13 beyond. It calls no library, so that loops over it are vectorised.
FN float falling_exponential(float x) {
  float y = min(x, 32.0f) * (1.0f / 64.0f);
  float e = 1.0f + y * (-1.0f + y * (0.5f + y * (-1.0f / 6.0f + y * (1.0f / 24.0f - y * (1.0f / 120.0f)))));
  e = e * e;
  e = e * e;
  e = e * e;
  e = e * e;
  e = e * e;
  return e * e;
}

// −2 log c, for c in (0, 1].
FN float squared_angle(float c) {
  float r = sqrt(c);
  float t = (1.0f - r) / (1.0f + r);  // −log r = 2 atanh t
  float t2 = t * t;
  return 8.0f * t * (1.0f + t2 * (1.0f / 3.0f + t2 * (0.2f + t2 * (1.0f / 7.0f + t2 * (1.0f / 9.0f)))));
}

// Mean of max(x, 0) where x spreads by `radius` to both sides.
FN float soft_positive(float x, float radius) {
  float t = max(x + radius, 0.0f);
  return x < radius ? t * t / (4.0f * radius) : x;
}

// Mean of the lobe over a light of this variance (radians², along each axis) around l. The lobe's Gaussian in the plane
// of half vectors is widened by the light's, whose width there is halved along the plane of v and l and divided by 2
// v·h across it (the Jacobian of reflection).
FN float light_lobe(float s, float variance, vec3 n, vec3 v, vec3 l) {
  vec3 sum = l + v;
  float inverse = 1.0f / sqrt(max(dot(sum, sum), 1e-12f));
  float c = clamp(dot(n, sum) * inverse, 1e-3f, 1.0f);
  float vh = max(dot(v, sum) * inverse, 1e-2f);
  vec3 b = cross(v, l);
  float nb = dot(n, b);
  float across = min(nb * nb / max(dot(b, b) * (1.0f - c * c), 1e-12f), 1.0f);
  float wider = 1.0f + 0.25f * s * variance;
  float wider_across = 1.0f + 0.25f * s * variance / (vh * vh);
  float x = 0.5f * s * squared_angle(c) * ((1.0f - across) / wider + across / wider_across);
  return falling_exponential(x) / sqrt(wider * wider_across) *
         soft_positive(dot(n, l), 1.5f * sqrt(variance));
}

// Share of a light that look-ups between levels k and k + 1 do not hold. part: the second level's share of the look-up.
// light_level: where the light's own width lies.
FN float light_share_between(float k, float part, float light_level) {
  float fine = min(k, 1.0f) * clamp(k - light_level, 0.0f, 1.0f);  // level 0 holds all of them
  float coarse = clamp(k + 1.0f - light_level, 0.0f, 1.0f);
  return fine + part * (coarse - fine);
}
// The same for a look-up at `level`.
FN float light_share(float level, float light_level) {
  float k = min(floor(level), 6.0f);
  return light_share_between(k, level - k, light_level);
}

// How much of a light a look-up sees, up to a factor. Both are round, and `spread` is the sum of their spreads
// (standard deviations squared). The result is rather too large when they are far from each other.
FN float seen_by_tap(vec3 direction, vec3 l, float spread) {
  float off = spread + 1.0f - dot(direction, l);
  return spread / (off * off);
}

// The column at which the tables of lobes are read: 0 at normal incidence, 16 at grazing.
FN float lobe_column(float cosine) { return 16.0f * sqrt(clamp(1.0f - cosine, 0.0f, 1.0f)); }

// Radiance under a round lobe around d, from spherical harmonics up to order 4 whose constants are folded in: band l is
// multiplied by component l − 1 of `bands`. Never negative.
FN vec3 harmonics_radiance(const vec3 c[25], vec3 d, vec4 bands) {
  float x2 = d.x * d.x;
  float y2 = d.y * d.y;
  float z2 = d.z * d.z;
  float xy = d.x * d.y;
  vec3 sum = c[0] + bands.x * (d.y * c[1] + d.z * c[2] + d.x * c[3]);
  sum += bands.y * (xy * c[4] + (d.y * d.z) * c[5] + (3.0f * z2 - 1.0f) * c[6] +
                    (d.x * d.z) * c[7] + (x2 - y2) * c[8]);
  sum += bands.z * ((d.y * (3.0f * x2 - y2)) * c[9] + (xy * d.z) * c[10] +
                    (d.y * (5.0f * z2 - 1.0f)) * c[11] + (d.z * (5.0f * z2 - 3.0f)) * c[12] +
                    (d.x * (5.0f * z2 - 1.0f)) * c[13] + (d.z * (x2 - y2)) * c[14] +
                    (d.x * (x2 - 3.0f * y2)) * c[15]);
  sum += bands.w * ((xy * (x2 - y2)) * c[16] + (d.y * d.z * (3.0f * x2 - y2)) * c[17] +
                    (xy * (7.0f * z2 - 1.0f)) * c[18] + (d.y * d.z * (7.0f * z2 - 3.0f)) * c[19] +
                    (z2 * (35.0f * z2 - 30.0f) + 3.0f) * c[20] +
                    (d.x * d.z * (7.0f * z2 - 3.0f)) * c[21] +
                    ((x2 - y2) * (7.0f * z2 - 1.0f)) * c[22] +
                    (d.x * d.z * (x2 - 3.0f * y2)) * c[23] +
                    (x2 * (x2 - 3.0f * y2) - y2 * (3.0f * x2 - y2)) * c[24]);
  return max(sum, 0.0f);
}
