// Glossy light from the chain of round lobes, its lights and spherical harmonics: the same as scene/glossy.cpp. Needs
// shared/radiance.glsl, shared/glossy.glsl, shared/placed_light.glsl, and looked() of shade.frag.glsl.
uniform samplerCube chain;       // levels 2 ... 7
uniform samplerCube first_lobe;  // level 1; level 0 is the map itself
uniform sampler2D lobe_table;    // rows: 4 taps, direction and integral, bands, spreads; columns: lobe_column()
uniform int taps;
uniform float exponent;
uniform float harmonics_share;
uniform vec3 harmonics[25];
uniform int light_count;
uniform vec4 light_place[8];  // direction, variance
uniform vec4 light_flux[8];   // flux, level
uniform float light_distance[8];  // inverse; 0: distant

vec3 chain_level(vec3 d, float k) {
  if (k < 0.5) return textureLod(radiance, d, 0.0).rgb;
  if (k < 1.5) return textureLod(first_lobe, d, 0.0).rgb;
  return textureLod(chain, d, k - 2.0).rgb;
}

// The two levels are blended here, because drivers round the blend to a few bits.
vec3 sample_chain(vec3 d, float level) {
  float k = floor(level);
  vec3 fine = chain_level(d, k), coarse = chain_level(d, min(k + 1.0, 7.0));
  return radiance_scale * (fine + (level - k) * (coarse - fine));
}

// Moves a look-up from d so that it shows near lights where they are. looked: what the map has in direction d, unit.
void move_look_up(vec3 d, float spread, PlacedLight seen[8], inout vec3 looked, inout float level) {
  MovedLookUp moved = MovedLookUp(vec3(0.0), 0.0, 0.0, 0.0);
  for (int j = 0; j < light_count; ++j) {
    float held = 1.0 - light_share(level, light_flux[j].w);
    if (light_distance[j] > 0.0 && held > 0.0)
      moved = moved_for(moved, d, looked, level, spread, held, seen[j], light_place[j].xyz, light_place[j].w,
                        light_flux[j].w);
  }
  looked = moved_direction(moved, looked);
  level = clamp(moved_level(moved, level), 0.0, 7.0);
}

vec3 glossy_from_chain(vec3 n, vec3 v, float cosine, vec3 position) {
  float c = clamp(cosine, 0.0, 1.0), sine = sqrt(1.0 - c * c);
  vec3 tangent = v - cosine * n;  // towards the view
  tangent /= max(length(tangent), 1e-6);
  vec3 mirror = c * n - sine * tangent, down = -sine * n - c * tangent;
  float at = lobe_column(c);
  int i = min(int(at), 15);
  float f = at - float(i);
  vec4 turn = mix(texelFetch(lobe_table, ivec2(i, 4), 0), texelFetch(lobe_table, ivec2(i + 1, 4), 0), f);
  PlacedLight seen[8];
  float near[8], left[8];
  for (int j = 0; j < light_count; ++j) {
    seen[j] = placed_light(light_place[j].xyz, light_distance[j], light_place[j].w, position - map_centre);
    near[j] = 1e-30;
    left[j] = 0.0;
  }
  vec3 value = vec3(0.0);
  if (harmonics_share > 0.0) {
    vec4 bands = mix(texelFetch(lobe_table, ivec2(i, 5), 0), texelFetch(lobe_table, ivec2(i + 1, 5), 0), f);
    value = harmonics_share * harmonics_radiance(harmonics, normalize(turn.x * mirror + turn.y * down), bands);
  }
  if (harmonics_share < 1.0) {
    vec4 spreads = mix(texelFetch(lobe_table, ivec2(i, 6), 0), texelFetch(lobe_table, ivec2(i + 1, 6), 0), f);
    for (int k = 0; k < taps; ++k) {
      vec4 tap = mix(texelFetch(lobe_table, ivec2(i, k), 0), texelFetch(lobe_table, ivec2(i + 1, k), 0), f);
      vec3 direction = tap.x * mirror + tap.y * down;
      vec3 to = normalize(looked(direction, position));
      move_look_up(direction, spreads[k], seen, to, tap.z);
      value += (1.0 - harmonics_share) * tap.w * sample_chain(to, tap.z);
      for (int j = 0; j < light_count; ++j) {
        float part = tap.w * seen_by_tap(direction, seen[j].direction, spreads[k] + seen[j].variance);
        near[j] += part;
        left[j] += part * light_share(tap.z, light_flux[j].w);
      }
    }
  }
  if (light_count > 0) {
    vec3 sum = vec3(0.0);
    for (int j = 0; j < light_count; ++j) {
      float share = harmonics_share + (1.0 - harmonics_share) * left[j] / near[j];
      sum += share * seen[j].gain * light_lobe(exponent, seen[j].variance, n, v, seen[j].direction) *
             light_flux[j].rgb;
    }
    value += exp2(-turn.z) * sum;
  }
  return value;
}
