// The irradiance by the method DIFFUSE: 0 none, 1 nearest-face, 2 six-face, 3 six-face-exact, 4 sh9, 5 a cube map of
// the irradiance, 6 sh9-lobes. Needs shared/lighting.glsl.
#if DIFFUSE == 5
uniform samplerCube baked;
uniform float baked_scale;  // stored values times this are irradiance
#elif DIFFUSE == 4
uniform vec3 light[9];
#elif DIFFUSE == 6
uniform vec3 light[9];
uniform vec3 lobes[12];
uniform ivec2 lobe_counts;  // number of lobes of the first colour, and of both
uniform vec3 lobe_colours[2];
#elif DIFFUSE
uniform vec3 light[6];
#endif

#if DIFFUSE
vec3 irradiance(vec3 n) {
#if DIFFUSE == 1
  return 3.14159265 * light[nearest_face(n)];
#elif DIFFUSE == 2
  return six_face_irradiance(light, n);
#elif DIFFUSE == 3
  return exact_face_irradiance(light, n);
#elif DIFFUSE == 4
  return sh9_irradiance(light, n);
#elif DIFFUSE == 6
  return lobes_irradiance(light, lobes, lobe_counts.x, lobe_counts.y, lobe_colours, n);
#else
  return baked_scale * textureLod(baked, n, 0.0).rgb;
#endif
}
#endif
