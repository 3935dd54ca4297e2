// GGX reflection by a few taps, for C++ (through scene/shared_formulas.h) and GLSL ES 3.00. Needs shared/ggx_light.glsl.
// All vectors are in the frame of tangent, bitangent and normal; alpha is (alpha_x, alpha_y) along the first two.
//
// Let s be the slopes of the half vector h = (−s, 1)/|…| and r = s/alpha. GGX's D is the density 1/(π (1 + r²)²) of r
// (Walter 2007, Heitz 2014), so the lobe D G2 / (4 n·v) of reflected light is that density times
//   q(r) = (v_z − s·v) · 2 l_z / (v_z |A l| + l_z |A v|),   |A w|² = w_z² + (alpha_x w_x)² + (alpha_y w_y)²,
// with height-correlated Smith masking, and ∫ q dP is the directional albedo.

struct GgxLobe {
  vec3 view;
  vec2 alpha;
  vec2 axis;        // in the space of r, along which the lobe is longest in the space of directions
  float spread;     // 0: round, all taps share one direction; 1: each tap is at its own part's middle
  float narrow;     // half the lobe's width across, radians
  float view_size;  // |A v|
};

// view: unit; interpolation may have put it below the horizon, and then it is lifted to the horizon.
FN GgxLobe ggx_lobe(vec3 view, vec2 alpha) {
  GgxLobe lobe;
  lobe.view = normalize(vec3(view.x, view.y, max(view.z, 1e-3f)));
  lobe.alpha = alpha;
  lobe.view_size = ggx_size(lobe.view, alpha);
  // Near the mirror direction a slope in the plane of incidence turns l by twice its size, and one across that plane by
  // twice its size times cos θ_v. So r is stretched by A (v_z² + v vᵀ) A, whose eigenvectors are the lobe's axes.
  vec3 v = lobe.view;
  float xx = alpha.x * alpha.x * (v.z * v.z + v.x * v.x);
  float yy = alpha.y * alpha.y * (v.z * v.z + v.y * v.y);
  float xy = alpha.x * alpha.y * v.x * v.y;
  float middle = 0.5f * (xx + yy);
  float apart = 0.5f * (xx - yy);
  float radius = sqrt(apart * apart + xy * xy);
  float turn = radius > 1e-6f * middle ? apart / radius : 1.0f;  // cosine of twice the angle
  lobe.axis = vec2(sqrt(max(0.5f + 0.5f * turn, 0.0f)), sqrt(max(0.5f - 0.5f * turn, 0.0f)));
  if (xy < 0.0f) lobe.axis.y = -lobe.axis.y;
  // Where both axes are equally long, their directions mean nothing: the taps then share one direction and differ in
  // width, so that nothing jumps where the axes turn or swap. 0.4: best on four of seven maps.
  float ratio = sqrt(max(middle - radius, 0.0f) / (middle + radius));
  lobe.spread = clamp((1.0f - ratio) / 0.4f, 0.0f, 1.0f);
  lobe.narrow = sqrt(max(middle - radius, 0.0f));
  return lobe;
}

// For r = x axis + y (axis turned by 90°): the light direction times q (x y z), and q (w).
FN vec4 ggx_slope(GgxLobe lobe, float x, float y) {
  float sx = lobe.alpha.x * (x * lobe.axis.x - y * lobe.axis.y);
  float sy = lobe.alpha.y * (x * lobe.axis.y + y * lobe.axis.x);
  vec3 v = lobe.view;
  float vh = max(v.z - sx * v.x - sy * v.y, 0.0f);  // v·h / n·h
  float k = 2.0f * vh / (1.0f + sx * sx + sy * sy);
  vec3 l = vec3(-k * sx - v.x, -k * sy - v.y, k - v.z);
  float up = max(l.z, 0.0f);
  float q = 2.0f * vh * up / (v.z * ggx_size(l, lobe.alpha) + up * lobe.view_size);
  return vec4(q * l.x, q * l.y, q * l.z, q);
}

// Solid angle of the directions around l, in the surface's frame, whose slopes r fill `area`: dl = 4 (v·h) dh, dh =
// (n·h)³ ds.
FN float ggx_solid_angle(GgxLobe lobe, vec3 l, float area) {
  vec3 sum = vec3(l.x + lobe.view.x, l.y + lobe.view.y, l.z + lobe.view.z);  // h times 2 v·h
  float size = sqrt(dot(sum, sum));
  float up = sum.z / size;
  return 2.0f * size * lobe.alpha.x * lobe.alpha.y * area * up * up * up;
}

// Where part k of the lobe's `count` parts begins along its axis. The parts are equal steps of u, with x = sinh(u),
// because the lobe's width across the axis grows with √(1 + x²), and so do the parts then. Given as x/√(1 + x²) =
// tanh(u); the last part ends at 1.
FN float ggx_begin(int k, int count) {
  if (k <= 0) return -1.0f;
  if (k >= count) return 1.0f;
  float top = 0.5f + 0.5f * log2(float(count));
  return tanh(top * (2.0f * float(k) / float(count) - 1.0f));
}

// Energy of the part between two such bounds (w), and its first moment (x y z): by two Gauss–Legendre nodes along the
// axis and, across it, three Gauss–Chebyshev nodes (second kind) at −1, 0 and 1 widths.
FN vec4 ggx_part(GgxLobe lobe, float begin, float end) {
  vec4 sum = vec4(0.0f);
  for (int i = 0; i < 2; ++i) {
    float c = 0.5f * (begin + end) + (float(i) - 0.5f) * 0.57735027f * (end - begin);
    float width = 1.0f / sqrt(1.0f - c * c);
    float x = c * width;
    sum += 0.5f * ggx_slope(lobe, x, 0.0f);
    sum += 0.25f * ggx_slope(lobe, x, width);
    sum += 0.25f * ggx_slope(lobe, x, -width);
  }
  return 0.25f * (end - begin) * sum;
}

// Direction of the whole lobe from the sum of its parts; the mirror direction if nothing is reflected.
FN vec3 ggx_centre(vec4 sum, vec3 view) {
  vec3 moment = vec3(sum.x, sum.y, sum.z);
  return normalize(sum.w > 1e-12f ? moment : vec3(-view.x, -view.y, max(view.z, 1e-3f)));
}

// Unit direction of a part's tap (x y z), and the standard deviation, in radians along each axis, by which the map is
// to be blurred there (w). 1.2: the three nodes leave out the tails. The deviation is at least that of the lobe across
// its axis, because a part of which the horizon leaves one node has no width of its own.
FN vec4 ggx_tap(GgxLobe lobe, vec4 part, vec3 centre) {
  vec3 mean = part.w > 1e-12f ? vec3(part.x, part.y, part.z) / part.w : centre;
  vec3 d = normalize((1.0f - lobe.spread) * centre + lobe.spread * normalize(mean));
  return vec4(d.x, d.y, d.z, 1.2f * sqrt(max(1.0f - dot(mean, d), lobe.narrow * lobe.narrow)));
}

// MIP level whose trilinear look-up blurs by this standard deviation, which is half a texel (a box and a tent); a
// texel's width is the root of the mean solid angle.
FN float blur_level(float face_size, float width) {
  return log2(max(width * face_size / 0.7236012f, 1.0f));
}

// Fresnel by Schlick from the albedos (f0 term, rest) of single scattering, and the light that is scattered more than
// once, with the lobe's own shape: Turquin 2019, Practical multiple scattering compensation for microfacet models.
// front, edge: light that single scattering reflects, weighed by the lobe with 1 − (1 − v·h)^5, which f0 still
// multiplies, and with (1 − v·h)^5.
FN vec3 ggx_reflected(vec3 f0, vec2 albedo, vec3 front, vec3 edge) {
  float whole = max(albedo.x + albedo.y, 1e-4f);
  return (f0 * front + edge) * (1.0f + f0 * (1.0f / whole - 1.0f));
}
// Where the table of the directional albedo is read, in [0, 1] along each axis: roughness from √0.02 to 1, cosine
// (fine near grazing), azimuth from the tangent.
FN vec3 ggx_albedo_coordinate(vec3 view, float roughness) {
  float x = abs(view.x);
  float y = abs(view.y);
  return vec3(clamp((roughness - 0.14142136f) / 0.85857864f, 0.0f, 1.0f), sqrt(clamp(view.z, 0.0f, 1.0f)),
              x + y > 1e-6f ? atan(y, x) / 1.5707963f : 0.0f);
}
