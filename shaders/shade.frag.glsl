#version 300 es
// Colour of the object (Eq. 3, 4 and 8). Variants:
//   DIFFUSE      0 none, 1 nearest-face, 2 six-face, 3 six-face-exact, 4 sh9, 5 a cube map of the irradiance,
//                6 sh9-lobes
//   GLOSSY       0 none, 1 the MIP chain, 2 exponent 0: the irradiance, 3 the chain of round lobes,
//                4 exponent below 1: between 2 and 3, 5 filtered samples; glTF's metallic-roughness model, with
//                BASE_COLOR_MAP METALLIC_MAP ROUGHNESS_MAP EMISSION_MAP NORMAL_MAP ANISOTROPIC 0 or 1: 6 from the
//                MIP chain, 7 from the chain of round lobes, 8 by filtered samples
//   PAPER        1: a lobe normalised as in Eq. 3, or by the exact factor, is multiplied by its
//                directional albedo, since the look-ups give its mean
//   COLORS       1: the mesh has colours
//   DISTORTION   1: the camera has a lens model
//   BOX          1: the walls of a box are seen at their true places
//   HOLDOUT      1: gives what is left of the light of real objects instead
#include "shared/precision.glsl"
#include "shared/lighting.glsl"
#include "shared/projection.glsl"

uniform usampler2D visible;       // number of a triangle; each of the four samples has a channel
uniform ivec2 corner;             // first pixel of the area that is drawn
uniform isampler2D triangles;     // vertices of each triangle
uniform sampler2D vertices;       // position and normal, one vertex after the other
uniform sampler2D shares;         // the shares of the irradiance (RGB) and of the glossy light that reach a vertex
uniform int backs;                // where the shares of the vertices' backs begin; 0: there are none
#if COLORS
uniform int colors;               // where colours begin among the vertices, whose positions and normals come first
#endif
uniform mat3 marker_from_object;
uniform vec3 marker_from_object_shift;
#if GLOSSY < 6
uniform vec3 emission;
#endif
layout(location = 0) out vec4 layer;  // radiance times coverage, and coverage

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

ivec2 texel(int i) { return ivec2(i & 1023, i >> 10); }
float edge(vec2 a, vec2 b) { return a.x * b.y - a.y * b.x; }  // from a to b, seen from the origin

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
  vec3 value = sampled_lobe(n, v);
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
#elif GLOSSY == 4
  vec3 glossy_share = mix(vec3(share.a), share.rgb, matte_share);
#else
  float glossy_share = share.a;
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

// Weights of a triangle's corners at a point of the picture, perspective-correct.
vec3 corner_weights(vec3 pa, vec3 pb, vec3 pc, vec2 p) {
  float area = edge(pb.xy - pa.xy, pc.xy - pa.xy);
  vec3 w = vec3(edge(pb.xy - p, pc.xy - p) / area, edge(pc.xy - p, pa.xy - p) / area, 0.0);
  w.z = 1.0 - w.x - w.y;
  w /= vec3(pa.z, pb.z, pc.z);
  return w / (w.x + w.y + w.z);
}

// Places of the four samples in a pixel, in 256ths.
const vec4 kSampleX = vec4(96.0, 224.0, 32.0, 160.0), kSampleY = vec4(32.0, 96.0, 160.0, 224.0);

#if !HOLDOUT
uniform float curved_cosine;

// Whether a triangle's normals, at the samples of a pixel that it covers, differ by much of the lobe's width.
bool is_curved(mat3 n, vec3 pa, vec3 pb, vec3 pc, vec2 pixel, bvec4 same) {
  if (min(min(dot(n[0], n[1]), dot(n[1], n[2])), dot(n[2], n[0])) >= curved_cosine) return false;
  vec3 at[4];
  for (int k = 0; k < 4; ++k) {
    if (!same[k]) continue;
    vec2 sample_at = pixel + vec2(kSampleX[k], kSampleY[k]) / 256.0;
    at[k] = normalize(n * corner_weights(pa, pb, pc, sample_at));
    for (int j = 0; j < k; ++j)
      if (same[j] && dot(at[j], at[k]) < curved_cosine) return true;
  }
  return false;
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
  // Shades once per triangle, at the middle of the samples that it covers, or at each of them where it is curved.
  while (any(left)) {
    uint number = left.x ? shown.x : left.y ? shown.y : left.z ? shown.z : shown.w;
    bvec4 same = equal(shown, uvec4(number));
    vec4 weight = vec4(same);
    float count = weight.x + weight.y + weight.z + weight.w;
    vec2 middle = vec2(dot(weight, kSampleX), dot(weight, kSampleY));
    vec2 p = vec2(local + corner) + floor(middle / count) / 256.0;

    ivec3 index = texelFetch(triangles, texel(int(number) - 1), 0).xyz;
    vec3 a = texelFetch(vertices, texel(2 * index.x), 0).xyz;
    vec3 b = texelFetch(vertices, texel(2 * index.y), 0).xyz;
    vec3 c = texelFetch(vertices, texel(2 * index.z), 0).xyz;
    vec3 pa = project(a), pb = project(b), pc = project(c);
#if !HOLDOUT
    mat3 normals = mat3(texelFetch(vertices, texel(2 * index.x + 1), 0).xyz,
                        texelFetch(vertices, texel(2 * index.y + 1), 0).xyz,
                        texelFetch(vertices, texel(2 * index.z + 1), 0).xyz);
    if (count > 1.0 && is_curved(normals, pa, pb, pc, vec2(local + corner), same)) {
      same = bvec4(left.x && same.x, false, false, false);
      if (!same.x) same.y = left.y && shown.y == number;
      if (!same.x && !same.y) same.z = left.z && shown.z == number;
      if (!same.x && !same.y && !same.z) same.w = true;
      count = 1.0;
      p = vec2(local + corner) + vec2(dot(vec4(same), kSampleX), dot(vec4(same), kSampleY)) / 256.0;
    }
#endif
    vec3 w = corner_weights(pa, pb, pc, p);
    vec3 at = w.x * a + w.y * b + w.z * c;
    // As y points down in the picture, a triangle seen from outside runs clockwise: its area is negative.
    bool behind = edge(pb.xy - pa.xy, pc.xy - pa.xy) > 0.0;
    ivec3 of = behind ? index + backs : index;
    vec4 share = w.x * texelFetch(shares, texel(of.x), 0) + w.y * texelFetch(shares, texel(of.y), 0) +
                 w.z * texelFetch(shares, texel(of.z), 0);
#if HOLDOUT
    vec3 colour = share.rgb;
#else
    vec3 n = normals * w;
    n = marker_from_object * (behind ? -n : n);
    float size = length(n);
    n = size > 0.0 ? n / size : vec3(0.0, 0.0, 1.0);
    vec3 position = marker_from_object * at + marker_from_object_shift;
#if COLORS
    vec3 color = w.x * texelFetch(vertices, texel(colors + index.x), 0).rgb +
                 w.y * texelFetch(vertices, texel(colors + index.y), 0).rgb +
                 w.z * texelFetch(vertices, texel(colors + index.z), 0).rgb;
#else
    const vec3 color = vec3(1.0);
#endif
#if GLOSSY >= 6
    vec4 t = w.x * texelFetch(tangents, texel(index.x), 0) + w.y * texelFetch(tangents, texel(index.y), 0) +
             w.z * texelFetch(tangents, texel(index.z), 0);
    t = vec4(marker_from_object * t.xyz, t.w < 0.0 ? -1.0 : 1.0);
    if (behind) t = -t;  // from behind a bump is a dent
    mat3x2 uv = mat3x2(texelFetch(uvs, texel(index.x), 0).xy, texelFetch(uvs, texel(index.y), 0).xy,
                       texelFetch(uvs, texel(index.z), 0).xy);
    vec2 here = uv * w;
    vec2 dx = uv * corner_weights(pa, pb, pc, p + vec2(1.0, 0.0)) - here;
    vec2 dy = uv * corner_weights(pa, pb, pc, p + vec2(0.0, 1.0)) - here;
    SurfacePoint surface = surface_point(n, t, here, dx, dy);
    surface.base_color *= color;
    vec3 colour = shade(position, share, surface);
#else
    vec3 colour = shade(position, n, share, color);
#endif
#endif
    layer += count * 0.25 * vec4(colour, 1.0);
    left = bvec4(left.x && !same.x, left.y && !same.y, left.z && !same.z, left.w && !same.w);
  }
}
