#version 300 es
// Colour of the object (Eq. 3, 4 and 8). Variants:
//   DIFFUSE      see shared/irradiance.glsl
//   GLOSSY       0 none, 1 the MIP chain, 2 exponent 0: the irradiance, 3 the chain of round lobes,
//                4 exponent below 1: between 2 and 3, 5 filtered samples; glTF's metallic-roughness model, with
//                BASE_COLOR_MAP METALLIC_MAP ROUGHNESS_MAP EMISSION_MAP NORMAL_MAP ANISOTROPIC 0 or 1: 6 from the
//                MIP chain, 7 from the chain of round lobes, 8 by filtered samples
//   PAPER        1: a lobe normalised as in Eq. 3, or by the exact factor, is multiplied by its
//                directional albedo, since the look-ups give its mean
//   COLORS       1: the mesh has colours
//   DISTORTION   1: the camera has a lens model
//   BOX          1: the walls of a box are seen at their true places
//   BY_PIXEL     1: each part of a pixel has its own shares
//   HOLDOUT      1: gives what is left of the light of real objects instead
#include "shared/precision.glsl"
#include "shared/lighting.glsl"
#include "shared/projection.glsl"

#include "shared/pixel_parts.glsl"

#if BY_PIXEL
#include "shared/part_tiles.glsl"
uniform sampler2D pixel_shares;  // those of each part of a pixel, see pixel_shares.frag.glsl
#endif
#if COLORS
uniform int colors;               // where colours begin among the vertices, whose positions and normals come first
#endif
uniform mat3 marker_from_object;
uniform vec3 marker_from_object_shift;
#if GLOSSY < 6
uniform vec3 emission;
#endif
layout(location = 0) out vec4 layer;  // radiance times coverage, and coverage

#include "shared/irradiance.glsl"
#if DIFFUSE
#if GLOSSY < 6
uniform vec3 diffuse_albedo;
#endif
#endif

#if GLOSSY && GLOSSY < 6
uniform vec3 glossy_albedo;
#endif
#if GLOSSY
uniform vec3 eye;  // marker frame
#if GLOSSY != 2
#include "shared/radiance.glsl"
#include "shared/sphere_cap.glsl"
#include "shared/placed_light.glsl"
#include "shared/near_light.glsl"
uniform vec3 map_centre;  // marker frame
#if BOX
uniform vec3 box_lower, box_upper;  // from map_centre
uniform vec2 box_axis;
#endif

// The direction in which the map shows what is seen from `position` in direction d.
vec3 looked(vec3 d, vec3 position) {
#if BOX
  return box_direction(d, position - map_centre, box_lower, box_upper, box_axis);
#else
  return d;
#endif
}
#endif
#if GLOSSY == 1
uniform float level;
#elif GLOSSY == 5
#include "shared/sampled_lobe.glsl"
#elif GLOSSY == 3 || GLOSSY == 4 || GLOSSY == 7
#include "shared/glossy.glsl"
#include "shared/glossy_chain.glsl"
#endif
#if GLOSSY == 1 || GLOSSY >= 3 && GLOSSY <= 5
uniform float matte_share;  // for exponents below 1
#endif
#if GLOSSY >= 6
#include "shared/pbr_maps.glsl"
#endif
#if PAPER
uniform float albedo_scale;
uniform sampler2D albedo_table;  // rows: exponent coordinate, columns: cosine, ends included
uniform float albedo_row;        // exponent coordinate

float directional_albedo(float cosine) {
  ivec2 last = textureSize(albedo_table, 0) - 1;
  vec2 p = vec2(clamp(cosine, 0.0, 1.0), albedo_row) * vec2(last);
  ivec2 i = min(ivec2(p), last - 1);
  vec2 f = p - vec2(i);
  float a = texelFetch(albedo_table, i, 0).r, b = texelFetch(albedo_table, i + ivec2(1, 0), 0).r;
  float c = texelFetch(albedo_table, i + ivec2(0, 1), 0).r,
        d = texelFetch(albedo_table, i + ivec2(1, 1), 0).r;
  float upper = a + f.x * (b - a), lower = c + f.x * (d - c);
  return albedo_scale * (upper + f.y * (lower - upper));
}
#endif
#endif

#if GLOSSY < 6
vec3 shade(vec3 position, vec3 n, vec4 share, vec3 color) {
  vec3 colour = emission;
#if DIFFUSE || GLOSSY == 2 || GLOSSY == 4
  vec3 e = irradiance(n) / 3.14159265;
  colour += (share.rgb * diffuse_albedo * color) * e;
#endif
#if GLOSSY
  vec3 v = normalize(eye - position);
  float cosine = dot(n, v);
#if GLOSSY == 2
  vec3 value = e;
#elif GLOSSY == 1
  vec3 value = sample_radiance(looked(2.0 * cosine * n - v, position), level);
#elif GLOSSY == 5
  vec3 value = sampled_lobe(n, v, position);
#else
  vec3 value = glossy_from_chain(n, v, cosine, position);
#endif
#if GLOSSY == 4
  value += matte_share * (e - value);
#endif
#if PAPER
  value *= directional_albedo(cosine);
#endif
#if GLOSSY == 2
  vec3 glossy_share = share.rgb;
#else
  vec3 glossy_share = mix(vec3(share.a), share.rgb, matte_share);
#endif
  colour += glossy_share * glossy_albedo * value;
#endif
  return colour;
}
#else
vec3 shade(vec3 position, vec4 share, SurfacePoint p) {
  vec3 v = normalize(eye - position);
  vec3 local = v * p.frame;
  vec2 albedo = sample_ggx_albedo(local, p.roughness);
  vec3 edge;
  vec3 front = sample_ggx(p.frame, local, alpha_of(p.roughness), position, albedo, edge);
  vec3 colour = p.emission + share.a * pbr_reflected(p.base_color, p.metallic, dielectric, albedo, front, edge);
#if DIFFUSE
  colour += pbr_diffuse(p.base_color, p.metallic, dielectric, albedo) * (share.rgb / 3.14159265) * irradiance(p.frame[2]);
#endif
  return colour;
}
#endif

void main() {
  ivec2 local = ivec2(gl_FragCoord.xy);
  uvec4 shown = texelFetch(visible, local, 0);
  // Numbers from 2^31 on are those of the triangles of real objects.
  uvec4 real = shown >> 31u;
#if HOLDOUT
  shown = (shown & 0x7fffffffu) * real;
#else
  shown *= 1u - real;
#endif
  bvec4 left = notEqual(shown, uvec4(0u));
  layer = vec4(0.0);
  // Shades once per part, at the middle of the samples that it covers.
  while (any(left)) {
    Part part = next_part(shown, local + corner, left);
#if BY_PIXEL
    vec4 share = texelFetch(pixel_shares, local + tile * tile_of(part.first), 0);
#else
    vec4 share = interpolated_share(part);
#endif
#if HOLDOUT
    vec3 colour = share.rgb;
#else
    vec3 w = part.w;
    vec3 n = part_normal(part, marker_from_object);
    vec3 position = marker_from_object * (w.x * part.a + w.y * part.b + w.z * part.c) + marker_from_object_shift;
#if COLORS
    vec3 color = w.x * texelFetch(vertices, texel(colors + part.index.x), 0).rgb +
                 w.y * texelFetch(vertices, texel(colors + part.index.y), 0).rgb +
                 w.z * texelFetch(vertices, texel(colors + part.index.z), 0).rgb;
#else
    const vec3 color = vec3(1.0);
#endif
#if GLOSSY >= 6
    vec4 t = w.x * texelFetch(tangents, texel(part.index.x), 0) + w.y * texelFetch(tangents, texel(part.index.y), 0) +
             w.z * texelFetch(tangents, texel(part.index.z), 0);
    t = vec4(marker_from_object * t.xyz, t.w < 0.0 ? -1.0 : 1.0);
    if (part.behind) t = -t;  // from behind a bump is a dent
    mat3x2 uv = mat3x2(texelFetch(uvs, texel(part.index.x), 0).xy, texelFetch(uvs, texel(part.index.y), 0).xy,
                       texelFetch(uvs, texel(part.index.z), 0).xy);
    vec2 here = uv * w;
    vec2 dx = uv * corner_weights(part.pa, part.pb, part.pc, part.p + vec2(1.0, 0.0)) - here;
    vec2 dy = uv * corner_weights(part.pa, part.pb, part.pc, part.p + vec2(0.0, 1.0)) - here;
    SurfacePoint surface = surface_point(n, t, here, dx, dy);
    surface.base_color *= color;
    vec3 colour = shade(position, share, surface);
#else
    vec3 colour = shade(position, n, share, color);
#endif
#endif
    layer += part.count * 0.25 * vec4(colour, 1.0);
  }
}
