#version 300 es
// Shadow of spheres on the marker plane. Variant: PRODUCT 0 cap-sum, 1 cap-product.
#include "shared/precision.glsl"
#include "shared/sphere_cap.glsl"
#include "shared/plane.glsl"
#include "shared/radiance.glsl"

uniform float texels;        // along an edge of the map
uniform float face_size;     // of the cube map
uniform vec3 inverse_irradiance;  // 1 / E(z); 0 where a channel has no light
uniform int count;
// Two rows: (x, y, z, r^2), then (z^2 - r^2, look-up z, 1 if part of the sphere lies below the horizon). Measured from
// the map's centre in half edges of the map, so that no length in metres overflows.
uniform sampler2D spheres;
layout(location = 0) out vec4 ratio;

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec2 p = vec2(plane_offset(pixel.x, texels), plane_offset(pixel.y, texels));
  float keep = shadow_keep(p, texels);
  vec3 left = vec3(1.0);
  for (int i = 0; i < count && keep > 0.0; ++i) {
    vec4 s = texelFetch(spheres, ivec2(i, 0), 0);
    vec4 extra = texelFetch(spheres, ivec2(i, 1), 0);
    vec2 d = s.xy - p;
    float across2 = dot(d, d);
    float outside2 = across2 + extra.x;
    if (!(outside2 > 0.0)) {
      left = vec3(0.0);
      break;
    }
    float d2 = across2 + s.z * s.z;
    float sin2_alpha = s.w / d2, cos2_alpha = outside2 / d2;
    float cos_theta = s.z * inversesqrt(d2);
    float projected = extra.z > 0.0 ? cap_projected_solid_angle(cos_theta, sin2_alpha, cos2_alpha)
                                    : 3.14159265 * sin2_alpha * cos_theta;
    vec3 seen = sample_radiance(vec3(d, extra.y), cap_mip_level(sin2_alpha, cos2_alpha, face_size));
    vec3 o = cap_obstruction(seen, projected, inverse_irradiance);
#if PRODUCT
    left *= 1.0 - o;
#else
    left = max(left - o, 0.0);
#endif
  }
  left = mix(left, vec3(1.0), equal(inverse_irradiance, vec3(0.0)));
  ratio = vec4(1.0 + keep * (left - 1.0), 1.0);
}
