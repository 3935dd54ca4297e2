#version 300 es
#include "shared/precision.glsl"
flat in uint shown;
layout(location = 0) out uint triangle;  // number from 1; 0: nothing

void main() { triangle = shown; }
