// The mesh on the GPU: corners for the visibility pass, tables for the shade pass. Private to
// render/gl.
#pragma once

#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/render/gl/gpu.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

class MeshBuffers {
 public:
  void upload(Gpu& gpu, const Scene& scene);
  const Mesh& mesh() const { return mesh_; }
  void bind(Gpu& gpu) const;      // the tables,
  void bind_uvs(Gpu& gpu) const;  // and those that pbr materials read besides

  // Corners to draw as triangles; they return how many.
  int use_whole() const;
  // Only triangles whose corners all lie before the camera and within the lens model.
  int use_visible_part(const Camera& camera, const Pose& camera_from_object) const;

 private:
  Texture triangles_, vertices_, normals_, tangents_, uvs_;
  GLuint buffers_[2] = {}, vertex_arrays_[2] = {};  // of the whole mesh, and of a part
  Mesh mesh_;                                       // that is in the buffers
  std::vector<glm::vec3> normal_;
  std::vector<float> visibility_;
  int corner_count_ = 0;
};

}  // namespace fastibl
