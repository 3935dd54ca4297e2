#version 300 es
// The finished picture, scaled to a framebuffer of the caller, whose row 0 is at the bottom. Variant:
//   ENCODES  1: the framebuffer takes linear values, and encodes them as sRGB
#include "shared/precision.glsl"
uniform sampler2D screen;
uniform vec2 size;  // of the framebuffer
layout(location = 0) out vec4 colour;

#if ENCODES
float linear_of(float code) { return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4); }
#endif

void main() {
  vec2 at = gl_FragCoord.xy / size;
  colour = textureLod(screen, vec2(at.x, 1.0 - at.y), 0.0);
#if ENCODES
  colour.rgb = vec3(linear_of(colour.r), linear_of(colour.g), linear_of(colour.b));
#endif
}
