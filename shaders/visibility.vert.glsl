#version 300 es
// Which triangle covers each of a pixel's four samples: drawn once per sample, shifted so that the
// sample lies at the pixel's centre. Multisampled targets would cover the same samples, but it is
// up to the driver where they shade a partly covered pixel.
#include "shared/precision.glsl"
#include "shared/projection.glsl"

layout(location = 0) in vec3 position;  // mesh frame
layout(location = 1) in uint triangle;
uniform vec4 area;       // the part of the picture that is drawn: first pixel, width and height
uniform vec2 shift;      // from the sample to the pixel's centre
uniform vec2 depth;      // depth = x + y / z, -1 in front of the object and 1 behind it
uniform uint first;      // added to the number: 0, or 2^31 for what hides the object
flat out uint shown;

void main() {
  vec3 p = project(position);
  // Row 0 of the target is row 0 of the picture, so y is not flipped.
  vec2 clip = (p.xy - area.xy + shift) * 2.0 / area.zw - 1.0;
  float w = p.z;
  gl_Position = vec4(clip * w, clamp(depth.x * w + depth.y, -w, w), w);
  shown = triangle + first;
}
