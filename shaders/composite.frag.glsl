#version 300 es
// The back picture times the plane's gain, with the object over it, encoded with the camera's response. Variants:
//   MATTE       1: no back picture; straight alpha, a shadow is black
//   OBJECT      1: there is an object
//   SHADOW      1: there is a shadow map and a camera above the plane
//   DISTORTION  1: rays come from a table
//   VIGNETTING  number of coefficients
//   HOLDOUT     1: real objects are seen beside the object
//   DEEP        1: the back picture has more than 8 bits, and its linear light is given
//   STEEP       1: several codes may end within one of 4096 equal steps of linear values
#include "shared/precision.glsl"
#include "shared/plane.glsl"

uniform ivec2 corner;        // first pixel of the area that is drawn
uniform vec4 intrinsics;     // fx fy cx cy
uniform float exposure;      // exposure times gain
uniform vec2 levels;         // black and white of the response, as codes
uniform sampler2D response;  // row 0: linear value of each code; row 1: linear value where the code ends
uniform sampler2D guess;     // for each of 4096 equal steps: code at the step's lower end, and where that code ends
layout(location = 0) out vec4 picture;

#if !MATTE
uniform sampler2D back;
uniform ivec2 back_corner;  // its first pixel
#if DEEP
uniform sampler2D linear_back;
#endif
#endif
#if OBJECT
uniform sampler2D object;
uniform ivec4 object_area;  // first pixel, and one beyond the last
#if HOLDOUT
uniform sampler2D holdout;  // what is left of the real objects' light times coverage, and coverage
#endif
#endif
#if VIGNETTING
uniform float vignetting[VIGNETTING];
#endif
#if SHADOW
uniform sampler2D ratio_map;
uniform sampler2D outer_map;  // coarser, around ratio_map
uniform sampler2D fine_map;   // finer, where a compact light casts its shadow
uniform vec3 fine_place;   // centre, extent or 0
uniform vec4 ratio_place;  // centre, extent, the outer map's extent or 0
uniform vec3 eye;          // marker frame
uniform mat3 marker_from_camera;
#if DISTORTION
uniform sampler2D rays;  // x and y at z = 1; 1e30 beyond the lens model
#endif

bool inside(vec2 p, float size) {
  return p.x > -0.5 && p.y > -0.5 && p.x < size - 0.5 && p.y < size - 0.5;
}

vec3 bilinear(sampler2D map, vec2 p, int n) {
  ivec2 i = ivec2(floor(p));
  vec2 f = p - vec2(i);
  ivec2 lower = max(i, 0), upper = min(i + 1, n - 1);
  vec3 a = texelFetch(map, lower, 0).rgb;
  vec3 b = texelFetch(map, ivec2(upper.x, lower.y), 0).rgb;
  vec3 c = texelFetch(map, ivec2(lower.x, upper.y), 0).rgb;
  vec3 d = texelFetch(map, upper, 0).rgb;
  vec3 first = a + f.x * (b - a), second = c + f.x * (d - c);
  return first + f.y * (second - first);
}

vec3 ratio_at(vec2 point) {
  if (fine_place.z > 0.0) {
    int m = textureSize(fine_map, 0).x;
    float edge = float(m);
    vec2 q = (point - fine_place.xy) * (0.5 * edge / fine_place.z) + 0.5 * edge - 0.5;
    if (inside(q, edge)) return bilinear(fine_map, q, m);
  }
  int n = textureSize(ratio_map, 0).x;
  float size = float(n);
  vec2 p = (point - ratio_place.xy) * (0.5 * size / ratio_place.z) + 0.5 * size - 0.5;
  if (inside(p, size)) return bilinear(ratio_map, p, n);
  if (ratio_place.w > 0.0) {
    n = textureSize(outer_map, 0).x, size = float(n);
    p = (point - ratio_place.xy) * (0.5 * size / ratio_place.w) + 0.5 * size - 0.5;
    if (inside(p, size)) return bilinear(outer_map, p, n);
  }
  return vec3(1.0);
}
#endif

vec3 ratio_of_pixel(ivec2 pixel) {
#if SHADOW
#if DISTORTION
  vec2 ideal = texelFetch(rays, pixel, 0).xy;
  if (ideal.x > 1e29) return vec3(1.0);
#else
  vec2 ideal = (vec2(pixel) + 0.5 - intrinsics.zw) / intrinsics.xy;
#endif
  vec3 ray = marker_from_camera * vec3(ideal, 1.0);
  if (ray.z < 0.0) return ratio_at(plane_point(eye, ray));
#endif
  return vec3(1.0);
}

float exposure_at(ivec2 pixel) {
#if VIGNETTING
  vec2 p = (vec2(pixel) + 0.5 - intrinsics.zw) / intrinsics.xy;
  float r2 = dot(p, p), factor = 1.0, power = r2;
  for (int i = 0; i < VIGNETTING; ++i) {
    factor += vignetting[i] * power;
    power *= r2;
  }
  return exposure * max(factor, 1e-3);
#else
  return exposure;
#endif
}

// The nearest code divided by 255: guessed, then corrected by the thresholds between codes.
float encode(float linear) {
  linear = linear > 0.0 ? min(linear, 1.0) : 0.0;  // NaN too
  int bin = min(int(linear * 4096.0), 4095);
  vec2 first = texelFetch(guess, ivec2(bin & 63, bin >> 6), 0).rg;
  float code = linear >= first.y ? first.x + 1.0 : first.x;
#if STEEP
  while (linear >= texelFetch(response, ivec2(int(code), 1), 0).r) code += 1.0;
#endif
  return code / 255.0;
}
vec3 encode(vec3 linear) { return vec3(encode(linear.r), encode(linear.g), encode(linear.b)); }
float decode(float encoded) {
  return texelFetch(response, ivec2(int(encoded * 255.0 + 0.5), 0), 0).r;
}

void main() {
  ivec2 local = ivec2(gl_FragCoord.xy), pixel = local + corner;
  vec4 o = vec4(0.0);
#if OBJECT
  if (all(greaterThanEqual(pixel, object_area.xy)) && all(lessThan(pixel, object_area.zw)))
    o = texelFetch(object, pixel - object_area.xy, 0);
#endif
  vec3 ratio = o.a < 1.0 ? ratio_of_pixel(pixel) : vec3(1.0);
#if HOLDOUT
  if (o.a < 1.0 && all(greaterThanEqual(pixel, object_area.xy)) && all(lessThan(pixel, object_area.zw))) {
    vec4 h = texelFetch(holdout, pixel - object_area.xy, 0);
    if (h.a > 0.0) ratio = (h.rgb + max(1.0 - o.a - h.a, 0.0) * ratio) / (1.0 - o.a);
  }
#endif
#if MATTE
  float alpha = o.a + (1.0 - o.a) * shadow_alpha(ratio);
  picture = alpha > 0.0
                ? vec4(encode(exposure_at(pixel) * o.rgb / alpha), floor(255.0 * alpha + 0.5) / 255.0)
                : vec4(0.0);
#else
  vec3 seen = texelFetch(back, pixel - back_corner, 0).rgb;
  picture = vec4(seen, 1.0);
  if (o.a > 0.0 || ratio != vec3(1.0)) {
#if DEEP
    vec3 behind = texelFetch(linear_back, local, 0).rgb;
#else
    vec3 behind = vec3(decode(seen.r), decode(seen.g), decode(seen.b));
#endif
    vec3 lit = encode(exposure_at(pixel) * o.rgb + (1.0 - o.a) * ratio * behind);
    // A value beyond the response's levels stays there unless it becomes another code.
    picture.rgb = mix(lit, seen, lessThan(abs(lit - clamp(seen, levels.x, levels.y)), vec3(0.5 / 255.0)));
  }
#endif
}
