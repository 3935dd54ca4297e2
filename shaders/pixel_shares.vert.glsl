#version 300 es
#include "shared/full_screen.glsl"
