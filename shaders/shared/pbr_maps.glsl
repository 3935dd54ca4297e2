// A pbr material at a point of the surface, and the light that it reads: GLSL's side of shading/shade.cpp and
// scene/ggx.cpp. Needs shared/radiance.glsl, and for GLOSSY 7 shared/glossy_chain.glsl.
#include "shared/ggx_light.glsl"
#include "shared/ggx.glsl"
#if GLOSSY == 8
#include "shared/sampled_lobe.glsl"
#else
uniform float face_size;
#endif
#include "shared/material.glsl"
uniform sampler2D tangents;  // of the vertices; w: on which side of n x t v grows
uniform sampler2D uvs;
uniform vec3 base_color, emission;
uniform float metallic, roughness, normal_scale, anisotropy;
uniform vec4 dielectric;  // see pbr_reflected
uniform vec2 turn;  // of the rougher direction, away from the tangent
uniform sampler2D base_color_map, metallic_map, roughness_map, emission_map, normal_map;
uniform sampler2D ggx_albedo;  // rows of cosines: each roughness, for the first azimuth, then the next
uniform int albedo_azimuths;

struct SurfacePoint {
  vec3 base_color, emission;
  float metallic, roughness;
  mat3 frame;
};

mat3 frame_around(vec3 n, vec3 tangent) {
  float size = length(tangent);
  vec3 across = cross(n, size > 1e-6 ? tangent / size : vec3(0.0));
  if (!(dot(across, across) > 1e-8)) across = cross(n, abs(n.x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
  across = normalize(across);
  return mat3(cross(across, n), across, n);
}

// Trilinear; its two levels are blended here, as in radiance.glsl.
vec3 read_map(sampler2D map, vec2 uv, vec2 dx, vec2 dy) {
  vec2 size = vec2(textureSize(map, 0));
  float top = floor(log2(max(size.x, size.y)));
  float level = clamp(texture_level(size, dx, dy), 0.0, top);
  float k = floor(level);
  vec2 at = vec2(uv.x, 1.0 - uv.y);
  vec3 fine = textureLod(map, at, k).rgb;
  return mix(fine, textureLod(map, at, min(k + 1.0, top)).rgb, level - k);
}

SurfacePoint surface_point(vec3 n, vec4 t, vec2 uv, vec2 dx, vec2 dy) {
  SurfacePoint p;
  p.base_color = base_color;
  p.emission = emission;
  p.metallic = metallic;
  p.roughness = roughness;
#if BASE_COLOR_MAP
  p.base_color *= read_map(base_color_map, uv, dx, dy);
#endif
#if EMISSION_MAP
  p.emission *= read_map(emission_map, uv, dx, dy);
#endif
#if METALLIC_MAP
  p.metallic *= read_map(metallic_map, uv, dx, dy).r;
#endif
#if ROUGHNESS_MAP
  p.roughness *= read_map(roughness_map, uv, dx, dy).r;
#endif
  p.frame = frame_around(n, t.xyz);
#if NORMAL_MAP
  vec3 bent = p.frame * (read_map(normal_map, uv, dx, dy) * vec3(normal_scale, normal_scale * t.w, 1.0));
  if (dot(bent, bent) > 1e-12) p.frame = frame_around(normalize(bent), t.xyz);
#endif
#if ANISOTROPIC
  p.frame = frame_around(p.frame[2], turn.x * p.frame[0] + turn.y * t.w * p.frame[1]);
#endif
  return p;
}

vec2 alpha_of(float rough) {
  float across = rough * rough;
  return clamp(vec2(across + (1.0 - across) * anisotropy * anisotropy, across), 0.02, 1.0);
}

vec2 albedo_slice(vec3 at, int azimuth) {
  ivec2 i = ivec2(at.yx), base = ivec2(0, azimuth * 24);
  vec2 f = at.yx - vec2(i);
  vec2 low = mix(texelFetch(ggx_albedo, base + i, 0).rg, texelFetch(ggx_albedo, base + i + ivec2(1, 0), 0).rg, f.x);
  vec2 high = mix(texelFetch(ggx_albedo, base + i + ivec2(0, 1), 0).rg,
                  texelFetch(ggx_albedo, base + i + ivec2(1, 1), 0).rg, f.x);
  return mix(low, high, f.y);
}

// Directional albedo of single scattering: the f0 term and the rest.
vec2 sample_ggx_albedo(vec3 view, float rough) {
  vec3 at = ggx_albedo_coordinate(view, rough) * vec3(23.0, 23.0, float(albedo_azimuths - 1));
  at.xy = min(at.xy, 22.9999);
#if ANISOTROPIC
  int a = min(int(at.z), albedo_azimuths - 2);
  return mix(albedo_slice(at, a), albedo_slice(at, a + 1), at.z - float(a));
#else
  return albedo_slice(at, 0);
#endif
}

#if GLOSSY == 8
vec3 sample_ggx(mat3 frame, vec3 view, vec2 alpha, vec3 position, vec2 albedo, out vec3 edge) {
  vec3 front = sampled_ggx_lobe(frame, view, alpha, position, edge);
  edge *= albedo.y;
  return albedo.x * front;
}
#else
// As GgxOptions::for_shading.
#if ANISOTROPIC
const int kTaps = 16;
#else
const int kTaps = 8;
#endif

// GgxLight of the map: returns the light of the lobe times 1 - e; edge: that times e = (1 - v.h)^5.
vec3 sample_ggx(mat3 frame, vec3 view, vec2 alpha, vec3 position, vec2 albedo, out vec3 edge) {
  GgxLobe lobe = ggx_lobe(view, alpha);
  vec4 parts[kTaps];
  vec4 sum = vec4(0.0);
  float begin = -1.0;
  for (int k = 0; k < kTaps; ++k) {
    float end = ggx_begin(k + 1, kTaps);
    parts[k] = ggx_part(lobe, begin, end);
    sum += parts[k];
    begin = end;
  }
  vec3 centre = ggx_centre(sum, lobe.view);
  bool dark = !(sum.w > 1e-12);  // one tap at the mirror direction
  vec3 front = vec3(0.0);
  edge = vec3(0.0);
  vec2 total = vec2(0.0);
#if GLOSSY == 7
  vec3 towards[8];
  PlacedLight seen[8];
  float near[8], left[8];
  for (int j = 0; j < light_count; ++j) {
    seen[j] = placed_light(light_place[j].xyz, light_distance[j], light_place[j].w, position - map_centre);
    towards[j] = seen[j].direction * frame;
    near[j] = 1e-30;
    left[j] = 0.0;
  }
#endif
  for (int k = 0; k < (dark ? 1 : kTaps); ++k) {
    vec4 tap = dark ? vec4(centre, max(alpha.x, alpha.y)) : ggx_tap(lobe, parts[k], centre);
    float weight = dark ? 1.0 : parts[k].w / sum.w;
    float e = weight * ggx_edge(tap.xyz, lobe.view), f = weight - e;
    vec3 d = frame * tap.xyz, direction = looked(d, position);
#if GLOSSY == 7
    float level = lobe_level(tap.w, face_size);
    direction = normalize(direction);
    move_look_up(d, tap.w * tap.w, seen, direction, level);
    vec3 radiance = sample_chain(direction, level);
    for (int j = 0; j < light_count; ++j) {
      float part = weight * seen_by_tap(tap.xyz, towards[j], tap.w * tap.w + seen[j].variance);
      near[j] += part;
      left[j] += part * light_share(level, light_flux[j].w);
    }
#else
    vec3 radiance = sample_radiance(direction, blur_level(face_size, tap.w));
#endif
    front += f * radiance;
    edge += e * radiance;
    total += vec2(f, e);
  }
  front *= albedo.x / total.x;
  edge *= albedo.y / total.y;
#if GLOSSY == 7
  for (int j = 0; j < light_count; ++j) {
    float value = left[j] / near[j] * seen[j].gain *
                  ggx_light(lobe.view, lobe.alpha, lobe.view_size, towards[j], seen[j].variance);
    float e = ggx_edge(towards[j], lobe.view);
    front += (1.0 - e) * value * light_flux[j].rgb;
    edge += e * value * light_flux[j].rgb;
  }
#endif
  return front;
}
#endif
