// The names that the shared formulas are written with, for GLSL ES 3.00.
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp samplerCube;
precision highp isampler2D;
precision highp usampler2D;
#define FN
#define REAL float
#define REAL2 vec2
#define REAL3 vec3
