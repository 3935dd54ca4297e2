#version 300 es
// The picture of a camera that a texture of the caller's holds, row 0 on top, as codes. Variants:
//   EXTERNAL  1: the texture is of GL_TEXTURE_EXTERNAL_OES
//   LINEAR    1: its format is sRGB, so that linear values are read from it
#if EXTERNAL
#extension GL_OES_EGL_image_external_essl3 : require
#endif
#include "shared/precision.glsl"
#if EXTERNAL
uniform highp samplerExternalOES given;
#else
uniform sampler2D given;
#endif
uniform vec2 size;  // of the picture
uniform mat3 uv_from_picture;
layout(location = 0) out vec4 picture;

#if LINEAR
float code_of(float linear) { return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1.0 / 2.4) - 0.055; }
#endif

void main() {
  vec2 uv = (uv_from_picture * vec3(gl_FragCoord.xy / size, 1.0)).xy;
  picture = vec4(texture(given, uv).rgb, 1.0);
#if LINEAR
  picture.rgb = vec3(code_of(picture.r), code_of(picture.g), code_of(picture.b));
#endif
}
