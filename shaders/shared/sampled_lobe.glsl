// Glossy light by filtered samples: the same as scene/sampled_lobe.cpp. Needs shared/radiance.glsl, and for glTF's
// model shared/ggx_light.glsl and shared/ggx.glsl.
uniform int taps;
#if GLOSSY == 5
uniform float exponent;   // below infinity
#endif
uniform float face_size;  // texels along a face of level 0

vec3 nearest_texel(vec3 d) {
  vec3 a = abs(d);
  vec3 p = d / max(a.x, max(a.y, a.z));
  vec3 middle = (floor((0.5 * p + 0.5) * face_size) + 0.5) / face_size * 2.0 - 1.0;
  middle = clamp(middle, 1.0 / face_size - 1.0, 1.0 - 1.0 / face_size);
  if (a.x >= a.y && a.x >= a.z) p.yz = middle.yz;
  else if (a.y >= a.z) p.xz = middle.xz;
  else p.xy = middle.xy;
  return radiance_scale * textureLod(radiance, p, 0.0).rgb;
}

vec3 filtered_tap(vec3 l, float solid_angle, float texel_share) {
  vec3 a = abs(l);
  float major = max(a.x, max(a.y, a.z));
  float texel = 4.0 / (face_size * face_size) * major * major * major;
  float tap_level = 0.5 * log2(max(solid_angle, 1e-30) / texel);
  if (tap_level >= 0.0 || texel_share <= 0.0) return sample_radiance(l, tap_level);
  float share = texel_share * clamp(-tap_level - 1.0, 0.0, 1.0);
  vec3 blended = share < 1.0 ? sample_radiance(l, 0.0) : vec3(0.0);
  return share > 0.0 ? blended + share * (nearest_texel(l) - blended) : blended;
}

// For tap i: beyond, the share of the lobe that is farther from the normal; turn, the angle about the normal; side, the
// sign of that angle's sine.
void equal_share(int i, out float beyond, out float turn, out float side) {
  bool middle = i == taps - 1 && taps % 2 != 0;
  float k = float(i / 2), count = float(taps);
  beyond = middle ? 1.0 - 0.5 / count : (2.0 * k + 1.0) / count;
  turn = middle ? 0.0 : 3.14159265 * fract(k * 0.61803399 + 0.5);
  side = i % 2 == 0 ? 1.0 : -1.0;
}

#if GLOSSY == 5
vec3 sampled_lobe(vec3 n, vec3 v) {
  vec3 t = incidence_tangent(n, v), b = cross(n, t);
  float power = 1.0 / (exponent + 1.0), texel_share = sampled_texel_share(exponent, face_size);
  vec3 sum = vec3(0.0);
  float total = 0.0;
  for (int i = 0; i < taps; ++i) {
    float u, turn, side;
    equal_share(i, u, turn, side);
    float x = power * log(u), c = exp(x), y = 2.0 * x;
    // 1 - e^y without cancellation.
    float sine2 = y > -0.1 ? -y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y / 24.0))) : 1.0 - exp(y);
    float s = sqrt(max(sine2, 0.0));
    vec3 h = s * cos(turn) * t + side * s * sin(turn) * b + c * n;
    float vh = dot(v, h);
    vec3 l = 2.0 * vh * h - v;
    float nl = dot(n, l);
    if (!(vh > 0.0 && nl > 0.0)) continue;
    sum += vh * nl * filtered_tap(l, 4.0 * vh * 6.2831853 * power / float(taps) * c / u, texel_share);
    total += vh * nl;
  }
  return total > 1e-12 ? sum / total : sample_radiance(2.0 * dot(n, v) * n - v, 0.0);
}
#else
vec3 sampled_ggx_lobe(mat3 frame, vec3 view, vec2 alpha, out vec3 edge) {
  GgxLobe lobe = ggx_lobe(view, alpha);
  float texel_share = sampled_texel_share(2.0 / (alpha.x * alpha.y), face_size);
  vec3 front = vec3(0.0);
  edge = vec3(0.0);
  vec2 total = vec2(0.0);
  for (int i = 0; i < taps; ++i) {
    float u, turn, side;
    equal_share(i, u, turn, side);
    float steep = sqrt((1.0 - u) / u);
    vec4 part = ggx_slope(lobe, steep * cos(turn), side * steep * sin(turn));
    if (!(part.w > 0.0)) continue;
    vec3 l = part.xyz / part.w;
    float solid_angle = ggx_solid_angle(lobe, l, 3.14159265 / (u * u * float(taps)));
    vec3 radiance = filtered_tap(frame * l, solid_angle, texel_share);
    float e = part.w * ggx_edge(l, lobe.view), f = part.w - e;
    front += f * radiance;
    edge += e * radiance;
    total += vec2(f, e);
  }
  if (!(total.x + total.y > 1e-12)) {
    edge = sample_radiance(frame * vec3(-lobe.view.xy, lobe.view.z), 0.0);
    return edge;
  }
  edge /= total.y;
  return front / total.x;
}
#endif
