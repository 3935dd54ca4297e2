// The mesh on the GPU: triangle corners for the visibility pass, tables for the shade pass. Private
// to render/gl.
#pragma once

#include <span>
#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/render/gl/gpu.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/mesh.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/cut_to_view.h"

namespace fastibl {

class MeshBuffers {
 public:
  void upload(Gpu& gpu, const Scene& scene);
  // shares: what the object lets through of its light; empty: P_V of the scene.
  void upload_shares(Gpu& gpu, const Scene& scene, std::span<const glm::vec4> shares);
  const Mesh& mesh() const { return mesh_; }
  // Where the shares of the vertices' backs begin; 0: there are none.
  int backs() const {
    const std::size_t own = mesh_.vertices.size();
    return share_.size() > own ? int(own + cut_.vertices.size()) : 0;
  }
  // Where the vertices' colours begin; 0: there are none.
  int colors() const {
    return mesh_.colors.empty() ? 0 : 2 * int(mesh_.vertices.size() + cut_.vertices.size());
  }
  void bind(Gpu& gpu) const;      // the tables,
  void bind_uvs(Gpu& gpu) const;  // and those that pbr materials also read

  struct Corners {  // to draw as triangles
    GLuint vertex_array = 0;
    int count = 0;
  };
  // Prepares them. Call before bind(). They are cut to what lies before the camera and within the
  // lens model, unless all does, and split where the lens bends edges.
  Corners use(Gpu& gpu, const Camera& camera, const Pose& camera_from_object,
              bool all_before_camera);

 private:
  void upload_tables(Gpu& gpu, const Mesh& mesh);
  void upload_share_table(Gpu& gpu, const Mesh& mesh, const std::vector<glm::vec4>& shares);
  void set_cut(Gpu& gpu, CutMesh cut);

  Texture triangles_, vertices_, tangents_, uvs_, shares_;
  GLuint buffers_[2] = {}, vertex_arrays_[2] = {};  // of the whole mesh, and of the cut one
  Mesh mesh_;                                       // the mesh that is in the buffers
  std::vector<glm::vec3> normal_;
  std::vector<glm::vec4> tangent_;  // may be empty
  std::vector<glm::vec4> share_;    // those that are in shares_
  LeastBent least_bent_;
  CutMesh cut_;  // its new vertices and triangles follow the mesh's in the textures
  int corner_count_ = 0;
};

}  // namespace fastibl
