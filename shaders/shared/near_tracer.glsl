// The light of near lights at places between vertices: the same as shading/near_tracer.cpp. Needs shared/tree.glsl,
// shared/bright_cells.glsl and shared/near_light.glsl.
uniform highp usampler2D near_lights;   // three texels each, see NearLight; then two for each bright cell, the parts of
                                        // the light of up to seven near lights that it has
uniform highp usampler2D near_entries;  // two texels each: states, two bits for each light; changes by light
uniform int near_count;
uniform vec3 near_centre;  // of the map, object's frame

struct NearLight {
  vec3 direction;          // from the map's centre, object's frame
  float inverse_distance;
  vec3 irradiance;
  float sin_radius;
  uvec2 cells;             // that have its light, a bit for each
  float flux;              // of it in the map
};

NearLight near_light(int i) {
  uvec4 a = texelFetch(near_lights, texel(3 * i), 0), b = texelFetch(near_lights, texel(3 * i + 1), 0);
  vec4 c = uintBitsToFloat(a), d = uintBitsToFloat(b);
  uvec4 e = texelFetch(near_lights, texel(3 * i + 2), 0);
  return NearLight(c.xyz, c.w, d.xyz, d.w, e.xy, uintBitsToFloat(e.z));
}

// By light: 0 to 3, and 4 to 6.
struct NearParts {
  vec4 first, second;
};
NearParts near_parts(int cell) {
  int at = 3 * near_count + 2 * cell;
  return NearParts(uintBitsToFloat(texelFetch(near_lights, texel(at), 0)),
                   uintBitsToFloat(texelFetch(near_lights, texel(at + 1), 0)));
}
float near_part(NearParts parts, int i) { return i < 4 ? parts.first[i] : parts.second[i - 4]; }

// What an entry knows.
struct NearEntry {
  uvec4 a, b;
};
NearEntry near_entry(int entry) {
  return NearEntry(texelFetch(near_entries, texel(2 * entry), 0), texelFetch(near_entries, texel(2 * entry + 1), 0));
}
float near_change(NearEntry entry, int i) { return uintBitsToFloat(i < 3 ? entry.a[i + 1] : entry.b[i - 3]); }

// Of normals: below it, what is interpolated between them is off.
const float kNearBent = 0.985;

// Of a light, between three entries.
const uint kNearHidden = 2u, kNearMixed = 3u;  // 0: below the tangent plane, 1: open
uint near_between(NearEntry entries[3], int i) {
  uint result = 0u;
  for (int k = 0; k < 3; ++k) {
    uint state = (entries[k].a.x >> uint(2 * i)) & 3u;
    if (result == 0u) result = state;
    if (state != 0u && state != result) return kNearMixed;
  }
  return result;
}

// Which place of its disc, from the middle outwards, ray k goes to: first those around the rim.
int near_seed(int k) {
  int rest = k - 8;
  return rest < 0 ? 31 - 3 * k : rest < 16 ? 30 - 3 * (rest / 2) - rest % 2 : 23 - rest;
}

// A light as a place sees it.
struct NearDisc {
  vec3 towards, right, up;
  float sine;  // of its angular radius
};
NearDisc near_disc(NearLight light, vec3 arrow, vec3 n) {
  NearDisc disc;
  float size = length(arrow);
  disc.towards = size > 0.0 ? arrow / size : n;  // in its middle, any will do
  disc.right = normalize(cross(abs(disc.towards.x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0), disc.towards));
  disc.up = cross(disc.towards, disc.right);
  disc.sine = light.sin_radius / max(size, light.sin_radius);
  return disc;
}

// The direction to one of 32 places of its disc, from the middle outwards.
vec3 near_point(NearDisc disc, int seed) {
  float r = disc.sine * sqrt((float(seed) + 0.5) / 32.0), turn = 2.39996323 * float(seed);
  return sqrt(max(1.0 - r * r, 0.0)) * disc.towards + r * (cos(turn) * disc.right + sin(turn) * disc.up);
}

// The part of a light that nothing hides, among what lies above the tangent plane.
float near_open_part(NearLight light, vec3 arrow, vec3 n, vec3 starts[4], bool several) {
  if (length(arrow) <= light.sin_radius) return 1.0;  // inside it
  NearDisc disc = near_disc(light, arrow, n);
  float asked = 0.0, open = 0.0;
  for (int k = 0; k < 32; ++k) {
    if (k == 8 && (open == 0.0 || open == asked)) break;
    vec3 d = near_point(disc, near_seed(k));
    if (dot(d, n) <= 0.0) continue;
    asked += 1.0;
    if (!meets_mesh(starts[!several ? 0 : k < 8 ? 3 * (k & 1) : (k + 1) & 3], d)) open += 1.0;
  }
  return asked > 0.0 ? open / asked : 1.0;
}
