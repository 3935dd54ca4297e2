// What shared/pixel_parts.glsl reads. Private to render/gl.
#pragma once

#include "fastibl/core/pose.h"
#include "fastibl/render/gl/gpu.h"
#include "fastibl/render/gl/mesh_buffers.h"
#include "fastibl/render/gl/outline.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

struct PixelParts {
  const MeshBuffers& mesh;
  const Texture& visible;  // numbers of the triangles that samples show,
  const Area& area;        // of this part of the picture

  // For the program in use. curved_cosine: see shading/rasterize.h.
  void bind(Gpu& gpu, const Program& p, const Camera& camera, const Pose& camera_from_mesh,
            float curved_cosine) const {
    set_projection(p, camera, camera_from_mesh);
    gpu.bind("visible", visible);
    mesh.bind(gpu);
    glUniform1i(p.uniform("backs"), mesh.backs());
    glUniform2i(p.uniform("corner"), area.x0, area.y0);
    glUniform1f(p.uniform("curved_cosine"), curved_cosine);
  }
};

}  // namespace fastibl
