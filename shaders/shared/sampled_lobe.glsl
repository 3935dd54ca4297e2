// Glossy light by filtered samples: the same as scene/sampled_lobe.cpp. Needs shared/radiance.glsl,
// shared/placed_light.glsl, looked() of shade.frag.glsl, and for glTF's model shared/ggx_light.glsl and shared/ggx.glsl.
uniform int taps;
#if GLOSSY == 5
uniform float exponent;   // below infinity
#endif
uniform float face_size;  // texels along a face of level 0

uniform samplerCube near_radiance;  // what near lights send, as the map has it
uniform int near_count;
uniform vec4 near_places[32];  // directions of the lights from the map's centre, 1 / distance

vec3 texel_middle(vec3 d) {
  vec3 a = abs(d);
  vec3 p = d / max(a.x, max(a.y, a.z));
  vec3 middle = (floor((0.5 * p + 0.5) * face_size) + 0.5) / face_size * 2.0 - 1.0;
  middle = clamp(middle, 1.0 / face_size - 1.0, 1.0 - 1.0 / face_size);
  if (a.x >= a.y && a.x >= a.z) p.yz = middle.yz;
  else if (a.y >= a.z) p.xz = middle.xz;
  else p.xy = middle.xy;
  return p;
}

vec3 filtered_tap(samplerCube map, vec3 l, float solid_angle, float texel_share) {
  vec3 a = abs(l);
  float major = max(a.x, max(a.y, a.z));
  float texel = 4.0 / (face_size * face_size) * major * major * major;
  float tap_level = 0.5 * log2(max(solid_angle, 1e-30) / texel);
  if (tap_level >= 0.0 || texel_share <= 0.0) return sample_map(map, l, tap_level);
  float share = texel_share * clamp(-tap_level - 1.0, 0.0, 1.0);
  vec3 blended = share < 1.0 ? sample_map(map, l, 0.0) : vec3(0.0);
  if (!(share > 0.0)) return blended;
  return blended + share * (radiance_scale * textureLod(map, texel_middle(l), 0.0).rgb - blended);
}

// What `position` sees in direction d, near lights and walls where they are: the same as scene/seen_map.cpp.
vec3 seen_tap(vec3 d, vec3 position, float solid_angle, float texel_share) {
  vec3 l = normalize(looked(d, position));
  vec3 sum = filtered_tap(radiance, l, solid_angle, texel_share);
  if (near_count == 0) return sum;
  sum = max(sum - filtered_tap(near_radiance, l, solid_angle, texel_share), 0.0);
  for (int i = 0; i < near_count; ++i) {
    vec3 from = near_places[i].w * (position - map_centre);
    vec2 ways = sphere_crossings(d, from);
    for (int k = 0; k < 2; ++k) {
      float way = k == 0 ? ways.x : ways.y;
      vec3 met = from + way * d;
      bool own = way > 0.0;
      for (int j = 0; j < near_count; ++j)
        if (dot(met, near_places[j].xyz) > dot(met, near_places[i].xyz)) own = false;
      if (own) sum += filtered_tap(near_radiance, met, way * way * solid_angle, texel_share);
    }
  }
  return sum;
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
vec3 sampled_lobe(vec3 n, vec3 v, vec3 position) {
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
    sum += vh * nl * seen_tap(l, position, 4.0 * vh * 6.2831853 * power / float(taps) * c / u, texel_share);
    total += vh * nl;
  }
  return total > 1e-12 ? sum / total : seen_tap(2.0 * dot(n, v) * n - v, position, 0.0, 0.0);
}
#else
vec3 sampled_ggx_lobe(mat3 frame, vec3 view, vec2 alpha, vec3 position, out vec3 edge) {
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
    vec3 seen = seen_tap(frame * l, position, solid_angle, texel_share);
    float e = part.w * ggx_edge(l, lobe.view), f = part.w - e;
    front += f * seen;
    edge += e * seen;
    total += vec2(f, e);
  }
  if (!(total.x + total.y > 1e-12)) {
    edge = seen_tap(frame * vec3(-lobe.view.xy, lobe.view.z), position, 0.0, 0.0);
    return edge;
  }
  edge /= total.y;
  return front / total.x;
}
#endif
