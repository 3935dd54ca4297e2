#version 300 es
// A layer that was drawn larger, at the picture's size: means of scale x scale pixels each.
#include "shared/precision.glsl"
uniform sampler2D large;
uniform int scale;
layout(location = 0) out vec4 layer;

void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * scale;
  layer = vec4(0.0);
  for (int y = 0; y < scale; ++y)
    for (int x = 0; x < scale; ++x) layer += texelFetch(large, first + ivec2(x, y), 0);
  layer /= float(scale * scale);
}
