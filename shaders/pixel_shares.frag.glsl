#version 300 es
// The shares of the light that reach each part of a pixel, in place of those between the corners of its triangle: the
// same as shading/traced_lights.cpp and shading/glossy_shares.cpp. See shared/part_tiles.glsl for the target. Variants:
//   DIFFUSE      see shared/irradiance.glsl
//   LOBE         0 none, 1 Blinn's, 2 GGX's
//   RAYS         1: to the brightest cells of the light
//   NEAR         1: with them, to near lights where they are
//   DISTORTION   1: the camera has a lens model
#include "shared/precision.glsl"
#include "shared/lighting.glsl"
#include "shared/projection.glsl"
#include "shared/pixel_parts.glsl"
#include "shared/part_tiles.glsl"
#include "shared/irradiance.glsl"
#if LOBE
#include "shared/glossy.glsl"
#include "shared/lobe_cells.glsl"
#endif
#if RAYS
#include "shared/tree.glsl"
#include "shared/bright_cells.glsl"
uniform mat3 marker_from_object;
uniform float ray_offset;
uniform sampler2D self_shares;  // of the map alone, by entry, where `shares` has more
uniform bool has_others;
#endif
#if NEAR
#include "shared/sphere_cap.glsl"
#include "shared/placed_light.glsl"
#include "shared/near_light.glsl"
#include "shared/near_tracer.glsl"
#endif

uniform highp usampler2D entries;  // four texels each, see Corner
uniform int back_entries;         // where those of the vertices' backs begin; 0: there are none
uniform int own_vertices;         // the others are on a triangle, whose first two weights they have
uniform vec3 eye;                 // object's frame
layout(location = 0) out vec4 share;

// What a corner of a whole triangle knows.
struct Corner {
  vec3 position, normal;             // on the visible side
  vec3 origin;                       // start of its rays, without offset
  int masks;                         // where its masks begin
  uvec2 hidden, low, open, mixed;    // of the bright cells, a bit for each: see CellStates
};

Corner corner_of(int vertex, bool behind) {
  int at = 4 * (behind ? vertex + back_entries : vertex);
  uvec4 a = texelFetch(entries, texel(at), 0), b = texelFetch(entries, texel(at + 1), 0),
        c = texelFetch(entries, texel(at + 2), 0), d = texelFetch(entries, texel(at + 3), 0);
  vec3 normal = uintBitsToFloat(d.xyz);
  return Corner(texelFetch(vertices, texel(2 * vertex), 0).xyz, behind && back_entries == 0 ? -normal : normal,
                uintBitsToFloat(c.xyz), int(c.w), a.xy, a.zw, b.xy, b.zw);
}

// Weights between the corners of a whole triangle.
vec3 weights_of(int vertex, ivec3 corners) {
  if (vertex < own_vertices) return vec3(equal(corners, ivec3(vertex)));
  vec2 w = vec2(texelFetch(vertices, texel(2 * vertex), 0).w, texelFetch(vertices, texel(2 * vertex + 1), 0).w);
  return vec3(w, 1.0 - w.x - w.y);
}

bool has_bit(uvec2 bits, int i) { return ((i < 32 ? bits.x >> uint(i) : bits.y >> uint(i - 32)) & 1u) != 0u; }

// Where a part is on its whole triangle, in the object's frame.
struct Place {
  ivec3 index;    // of the vertices
  vec3 w;         // weights of the corners
  Corner a, b, c;
  vec3 position, normal;
};

Place place_of(Part part) {
  Place at;
  at.index = part.index;
  at.w = part.w;
  int whole = texelFetch(triangles, texel(part.triangle - 1), 0).w;
  if (whole > 0) {
    at.index = texelFetch(triangles, texel(whole - 1), 0).xyz;
    at.w = mat3(weights_of(part.index.x, at.index), weights_of(part.index.y, at.index),
                weights_of(part.index.z, at.index)) * part.w;
  }
  at.w = max(at.w, vec3(0.0));
  at.w /= at.w.x + at.w.y + at.w.z;
  at.a = corner_of(at.index.x, part.behind);
  at.b = corner_of(at.index.y, part.behind);
  at.c = corner_of(at.index.z, part.behind);
  at.position = part.w.x * part.a + part.w.y * part.b + part.w.z * part.c;
  at.normal = part_normal(part, mat3(1.0));
  return at;
}

#if RAYS
// Where rays start: on the round surface that the normals describe (Hanika 2021, Hacking the Shadow Terminator), in the
// middle of a part, or at its four samples. Returns whether there are four.
bool ray_starts(Part part, ivec2 pixel, Place at, out vec3 starts[4]) {
  vec3 p = at.position;
  vec3 middle = at.w.x * (at.a.origin - min(dot(p - at.a.position, at.a.normal), 0.0) * at.a.normal) +
                at.w.y * (at.b.origin - min(dot(p - at.b.position, at.b.normal), 0.0) * at.b.normal) +
                at.w.z * (at.c.origin - min(dot(p - at.c.position, at.c.normal), 0.0) * at.c.normal) +
                ray_offset * at.normal;
  starts = vec3[4](middle, middle, middle, middle);
  if (part.count < 4.0) return false;
  const float kLift = 0.3;  // towards the eye, which sees the sample: the surface may bend towards it, too
  for (int k = 0; k < 4; ++k) {
    vec3 u = corner_weights(part.pa, part.pb, part.pc, vec2(pixel) + vec2(kSampleX[k], kSampleY[k]) / 256.0);
    vec3 shown = u.x * part.a + u.y * part.b + u.z * part.c, beside = shown - p;
    starts[k] = middle + beside - kLift * length(beside) * normalize(shown - eye);
  }
  return true;
}

// The part of the irradiance's share that is not the map's.
vec3 share_of_others(Part part, Place at, vec3 share) {
  if (!has_others) return vec3(0.0);
  ivec3 of = part.behind ? at.index + back_entries : at.index;
  return share - (at.w.x * texelFetch(self_shares, texel(of.x), 0).rgb +
                  at.w.y * texelFetch(self_shares, texel(of.y), 0).rgb +
                  at.w.z * texelFetch(self_shares, texel(of.z), 0).rgb);
}

#if NEAR
#if DIFFUSE
vec3 near_share_of(vec3 part, vec3 whole) { return clamp(share_of(part, whole), -1.0, 1000.0); }

// What the lights in `asked` change of the share, less what is interpolated between the corners. By light: the part of it
// that is open, and the part that is hidden where the map has it. corner_e, e: irradiance of the corners and of the place.
vec3 near_changes(Place at, ivec3 of, NearEntry entries[3], int asked, float open[7], NearParts lost, vec3 offset,
                  mat3 corner_e, vec3 e) {
  vec3 sum = vec3(0.0);
  vec3 interpolated[3] = vec3[3](vec3(0.0), vec3(0.0), vec3(0.0)), all[3];
  for (int k = 0; k < 3; ++k) all[k] = texelFetch(self_shares, texel(of[k]), 0).rgb;
  for (int i = 0; i < near_count; ++i) {
    NearLight light = near_light(i);
    bool is_asked = (asked & (1 << i)) != 0;
    for (int k = 0; k < 3; ++k) {
      vec3 change = near_share_of(near_change(entries[k], i) * light.irradiance, corner_e[k]);
      all[k] += change;
      if (is_asked) interpolated[k] += change;
    }
    if (!is_asked) continue;
    vec3 arrow = near_arrow(light.direction, light.inverse_distance, offset);
    float here = open[i] * near_irradiance(arrow, light.sin_radius, at.normal);
    float there = (1.0 - near_part(lost, i)) * near_irradiance(light.direction, light.sin_radius, at.normal);
    sum += near_share_of((here - there) * light.irradiance, e);
  }
  for (int k = 0; k < 3; ++k) sum -= at.w[k] * (interpolated[k] - min(all[k], vec3(0.0)));  // no share is negative
  return sum;
}
#endif
#if LOBE
// A light of the map in the lobe of a place, with nothing hidden.
float near_in_lobe(NearLight light, vec3 arrow, vec3 n, vec3 view) {
  NearDisc disc = near_disc(light, arrow, n);
  float size = max(length(arrow), light.sin_radius), apart = sqrt(3.14159265 / 32.0) * disc.sine, sum = 0.0;
  for (int k = 0; k < 32; ++k) sum += square_height(n, view, near_point(disc, k), apart);
  return sum * light.flux / (size * size * 32.0);
}
#endif
#endif

#if LOBE
float middle_weight(BrightCell cell, vec3 n, vec3 view) {
  return square_height(n, view, cell.direction, cell_width) * cell.for_lobes;
}
#endif
#endif

vec4 part_share(Part part, ivec2 pixel) {
  vec4 result = interpolated_share(part);
  Place at = place_of(part);
  vec3 n = at.normal, w = at.w;
#if RAYS
  uvec2 hidden = (at.a.hidden & ~at.a.low) | (at.b.hidden & ~at.b.low) | (at.c.hidden & ~at.c.low);
  uvec2 asked = at.a.mixed | at.b.mixed | at.c.mixed | (hidden & (at.a.open | at.b.open | at.c.open));
#endif
  bool hides = false;  // whether anything of a near light may be hidden
#if NEAR
  ivec3 of = part.behind ? at.index + back_entries : at.index;
  NearEntry entries_near[3] = NearEntry[3](near_entry(of.x), near_entry(of.y), near_entry(of.z));
  int asked_near = 0;
  bool bent = min(dot(at.a.normal, at.b.normal), min(dot(at.b.normal, at.c.normal), dot(at.c.normal, at.a.normal))) <
              kNearBent;
  for (int i = 0; i < near_count; ++i) {
    uvec2 cells = near_light(i).cells;
    if ((cells.x | cells.y) == 0u) continue;
    uint state = near_between(entries_near, i);
    if (bent || ((asked.x & cells.x) | (asked.y & cells.y)) != 0u || state == kNearMixed) asked_near |= 1 << i;
    if (state == kNearMixed || state == kNearHidden) hides = true;
  }
#endif
#if LOBE
  bool touched = hides || result.a < 1.0 - 1e-6;
  vec3 view = normalize(eye - at.position);
  vec2 sums = vec2(0.0);
  if (touched) sums = cell_sums(n, view, ivec3(at.a.masks, at.b.masks, at.c.masks), w);
#else
  const bool touched = false;
#endif
#if RAYS
#if DIFFUSE && NEAR
  bool asks = (asked.x | asked.y) != 0u || asked_near != 0;
#elif DIFFUSE
  bool asks = (asked.x | asked.y) != 0u;
#else
  const bool asks = false;
#endif
  if (!asks && !touched) return result;
  vec3 starts[4];
  bool several = ray_starts(part, pixel, at, starts);

#if NEAR
  vec3 offset = 0.25 * (starts[0] + starts[1] + starts[2] + starts[3]) - near_centre;
  float in_lobe[7] = float[7](0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), near_open[7];
#if LOBE
  for (int i = 0; i < near_count && touched; ++i) {
    NearLight light = near_light(i);
    if (light.flux > 0.0)
      in_lobe[i] = near_in_lobe(light, near_arrow(light.direction, light.inverse_distance, offset), n, view);
    sums.x += in_lobe[i];
  }
  float seen_by_lobe = sums.x;
#else
  const float seen_by_lobe = 1.0;
#endif
  for (int i = 0; i < near_count; ++i) {
    near_open[i] = 1.0;
#if DIFFUSE
    bool wanted = (asked_near & (1 << i)) != 0 || in_lobe[i] > 0.001 * seen_by_lobe;
#else
    bool wanted = in_lobe[i] > 0.001 * seen_by_lobe;
#endif
    uint state = near_between(entries_near, i);
    if (!wanted || state == 0u || state == 1u) continue;
    NearLight light = near_light(i);
    near_open[i] = state == kNearHidden ? 0.0
                                        : near_open_part(light, near_arrow(light.direction, light.inverse_distance, offset),
                                                         n, starts, several);
  }
  NearParts near_lost = NearParts(vec4(0.0), vec4(0.0));
#endif
#if DIFFUSE
  vec3 e = irradiance(marker_from_object * n);
  mat3 corner_e = mat3(irradiance(marker_from_object * at.a.normal), irradiance(marker_from_object * at.b.normal),
                       irradiance(marker_from_object * at.c.normal));
  vec3 back = vec3(0.0), lost = vec3(0.0);
#endif
#if LOBE
  float all = sums.x;
  for (int i = 0; i < bright_cells && touched; ++i) all += middle_weight(bright_cell(i), n, view);
#endif
  const float kLow = -0.05;  // cosine below which a cell counts as below the horizon
  for (int i = 0; i < bright_cells; ++i) {
    bool is_asked = has_bit(asked, i);
    bool known_hidden = has_bit(hidden, i);
    SeenCell seen = SeenCell(known_hidden ? 0u : 0xffffffffu, known_hidden ? 1.0 : 0.0);
#if NEAR
    if (!is_asked && !touched && asked_near == 0) continue;
#else
    if (!is_asked && !touched) continue;
#endif
    BrightCell cell = bright_cell(i);
#if LOBE
    bool counts = touched && middle_weight(cell, n, view) > 0.001 * all;
#if !DIFFUSE
    if (!counts) continue;
#endif
#endif
    if (is_asked && dot(n, cell.direction) > kLow) seen = look_at(cell, starts, several);
#if NEAR
    if (asked_near != 0) {
      NearParts parts = near_parts(i);
      near_lost.first += seen.lost * parts.first;
      near_lost.second += seen.lost * parts.second;
    }
#endif
#if DIFFUSE
    if (is_asked) {
      if (has_bit(at.a.hidden, i)) back += w.x * share_of(at.a.normal * cell.moments, corner_e[0]);
      if (has_bit(at.b.hidden, i)) back += w.y * share_of(at.b.normal * cell.moments, corner_e[1]);
      if (has_bit(at.c.hidden, i)) back += w.z * share_of(at.c.normal * cell.moments, corner_e[2]);
      lost += seen.lost * share_of(max(n * cell.moments, vec3(0.0)), e);
    }
#endif
#if LOBE
    for (int r = 0; r < cell.count && counts; ++r) {
      vec4 ray = bright_ray(cell.first + r);
      float weight = ray_height(n, view, ray.xyz) * cell.flux * ray.w;
      sums += weight * vec2(1.0, 1.0 - float((seen.free >> uint(r)) & 1u));
    }
#endif
  }
#if DIFFUSE
  if (asks) {
    vec3 others = share_of_others(part, at, result.rgb);
    vec3 before = result.rgb - others;
    vec3 change = min(back, max(1.0 - before, vec3(0.0))) - lost;
#if NEAR
    if (asked_near != 0)
      others += near_changes(at, of, entries_near, asked_near, near_open, near_lost, offset, corner_e, e);
#endif
    result.rgb = max(clamp(before + change, 0.0, 1.0) + others, vec3(0.0));
  }
#endif
#if NEAR && LOBE
  for (int i = 0; i < near_count; ++i) sums.y += (1.0 - near_open[i]) * in_lobe[i];
#endif
#endif
#if LOBE
  if (touched) result.a = share_of_lobe(sums);
#endif
  return result;
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy), place = at / tile, local = at - tile * place;
  int mine = place.x + columns * place.y;
  uvec4 shown = texelFetch(visible, local, 0);
  shown *= 1u - (shown >> 31u);  // real objects have no shares
  bvec4 left = notEqual(shown, uvec4(0u));
  share = vec4(1.0);
  if (!left[mine]) return;
  while (any(left)) {
    Part part = next_part(shown, local + corner, left);
    if (part.first < mine) continue;
    if (part.first == mine) share = part_share(part, local + corner);
    return;
  }
}
