#version 300 es
#include "shared/precision.glsl"
flat in uint shown;
layout(location = 0) out uvec4 triangle;  // number from 1, in the channel of the sample; 0: nothing

void main() { triangle = uvec4(shown); }
