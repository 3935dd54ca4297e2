// Copies a camera's picture out of a texture of the caller's. Private to render/gl.
#pragma once

#include "fastibl/render/gl/gl_renderer.h"
#include "fastibl/render/gl/gpu.h"

namespace fastibl {

// Draws the picture into a texture of width × height pixels, row 0 on top, as codes. Throws as
// GlRenderer::set_back_texture does, before anything of `out` has changed.
void copy_picture(Gpu& gpu, const CameraTexture& from, int width, int height, Texture& out);

}  // namespace fastibl
