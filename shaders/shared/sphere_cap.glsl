// Obstruction of the light on the marker plane by one sphere, which a point of the plane sees as a
// spherical cap: half-angle alpha <= 90 degrees, its centre at the angle theta from the normal.

// Projected solid angle: the integral of max(cos, 0) over the cap; pi sin^2(alpha) cos(theta) when
// the cap is above the horizon. Lagarde and de Rousiers 2014, Moving Frostbite to Physically Based
// Rendering, section 4.7.2 (sphere light with horizon handling), after Snyder 1996, Area Light
// Sources for Real-Time Graphics. sin2_alpha and cos2_alpha are both given because one of them
// would always lose its digits in 1 - the other.
FN float cap_projected_solid_angle(float cos_theta, float sin2_alpha, float cos2_alpha) {
  if (cos_theta * cos_theta >= sin2_alpha)
    return 3.14159265f * sin2_alpha * max(cos_theta, 0.0f);
  float cot_alpha = sqrt(cos2_alpha / sin2_alpha);
  // theta = 0 comes here for alpha = 90 degrees only, where the cotangent is 0.
  float sin_theta = sqrt(max(1.0f - cos_theta * cos_theta, 1e-12f));
  float y = clamp(-cot_alpha * cos_theta / sin_theta, -1.0f, 1.0f);
  float chord = sin_theta * sqrt(1.0f - y * y);
  float projected =
      (cos_theta * acos(y) - cot_alpha * chord) * sin2_alpha + atan(chord, cot_alpha);
  return clamp(projected, 0.0f, 3.14159265f);
}

// The cap's solid angle 2 pi (1 - cos(alpha)) in texels of a cube with faces of face_size^2, each
// 4 pi / 6 face_size^2. 1 - cos(alpha) is sin^2(alpha) / (1 + cos(alpha)), stable for small caps.
FN float cap_texels(float sin2_alpha, float cos2_alpha, float face_size) {
  return 3.0f * face_size * face_size * sin2_alpha / (1.0f + sqrt(cos2_alpha));
}

// The MIP level at which a texel has the cap's solid angle; below 0 for a smaller cap.
FN float cap_mip_level(float sin2_alpha, float cos2_alpha, float face_size) {
  return 0.5f * log2(cap_texels(sin2_alpha, cos2_alpha, face_size));
}

// Share of the plane's irradiance that the cap holds back, per channel in [0, 1]. radiance: at the
// cap's centre. inverse_irradiance: 1 / E(z).
// One look-up cannot know that nothing is left beside a cap which fills the hemisphere, so above
// nine tenths of it the share of a uniform sky takes over: all covered is exactly 1.
FN vec3 cap_obstruction(vec3 radiance, float projected, vec3 inverse_irradiance) {
  float share = projected / 3.14159265f;
  if (share >= 0.999999f) return vec3(1.0f);
  vec3 seen = clamp(radiance * inverse_irradiance * projected, 0.0f, 1.0f);
  float full = clamp(10.0f * share - 9.0f, 0.0f, 1.0f);
  return seen + full * (vec3(share) - seen);
}
