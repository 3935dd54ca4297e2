// The back camera: from the mesh's frame to pixels. Variant: DISTORTION 0, 1.
uniform mat3 camera_from_object;
uniform vec3 camera_from_object_shift;
uniform vec4 intrinsics;  // fx fy cx cy
#if DISTORTION
uniform float lens[8];
#include "shared/lens.glsl"
#endif

// Pixel, snapped to 1/256 as rasterisers do, and depth.
vec3 project(vec3 x_in_object) {
  vec3 p = camera_from_object * x_in_object + camera_from_object_shift;
  vec2 ideal = p.xy / p.z;
#if DISTORTION
  ideal = distort(ideal, lens);
#endif
  vec2 pixel = ideal * intrinsics.xy + intrinsics.zw;
  return vec3(floor(pixel * 256.0 + 0.5) / 256.0, p.z);
}
