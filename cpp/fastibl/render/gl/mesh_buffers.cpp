#include "fastibl/render/gl/mesh_buffers.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "fastibl/render/gl/tables.h"

namespace fastibl {
namespace {

struct Corner {  // of a triangle, as the visibility pass reads it
  glm::vec3 position;
  GLuint triangle;
};

template <typename T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void fill(GLuint buffer, const std::vector<Corner>& corners, GLenum usage) {
  glBindBuffer(GL_ARRAY_BUFFER, buffer);
  glBufferData(GL_ARRAY_BUFFER, GLsizeiptr(corners.size() * sizeof(Corner)), corners.data(), usage);
}

}  // namespace

void MeshBuffers::upload(Gpu& gpu, const Scene& scene) {
  for (int i = 0; i < 2 && !vertex_arrays_[i]; ++i) {
    vertex_arrays_[i] = gpu.new_vertex_array();
    buffers_[i] = gpu.new_buffer();
    glBindVertexArray(vertex_arrays_[i]);
    glBindBuffer(GL_ARRAY_BUFFER, buffers_[i]);
    glEnableVertexAttribArray(0), glEnableVertexAttribArray(1);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, sizeof(Corner), nullptr);
    glVertexAttribIPointer(1, 1, GL_UNSIGNED_INT, sizeof(Corner),
                           reinterpret_cast<const void*>(sizeof(glm::vec3)));
  }
  if (same_bytes(scene.mesh.vertices, mesh_.vertices) &&
      same_bytes(scene.mesh.triangles, mesh_.triangles) &&
      same_bytes(scene.shown_normals(), normal_) && same_bytes(scene.tangents, tangent_) &&
      same_bytes(scene.mesh.uvs, mesh_.uvs) && same_bytes(scene.mesh.colors, mesh_.colors))
    return;
  mesh_ = {}, share_.clear();  // until all is uploaded: a failure must not pass for what is there
  cut_ = {};
  normal_ = scene.shown_normals(), tangent_ = scene.tangents;
  upload_tables(gpu, scene.mesh);
  std::vector<Corner> corners;
  for (const glm::ivec3& t : scene.mesh.triangles) {
    const GLuint number = GLuint(corners.size() / 3 + 1);
    for (int k = 0; k < 3; ++k) corners.push_back({scene.mesh.vertices[std::size_t(t[k])], number});
  }
  fill(buffers_[0], corners, GL_STATIC_DRAW);
  corner_count_ = int(corners.size());
  mesh_ = scene.mesh;
}

// New vertices and triangles of the cut follow the mesh's own, and tell where on which triangle
// they are.
void MeshBuffers::upload_tables(Gpu& gpu, const Mesh& mesh) {
  // Position and normal of each vertex in turn; after all of them the colours, where there are any.
  std::vector<glm::vec4> vertices, tangents;
  std::vector<glm::vec2> uvs;
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    vertices.emplace_back(mesh.vertices[i], 0);
    vertices.emplace_back(normal_[i], 0);
    tangents.push_back(tangent_.empty() ? glm::vec4(0) : tangent_[i]);
    uvs.push_back(mesh.uvs.empty() ? glm::vec2(0) : mesh.uvs[i]);
  }
  std::vector<glm::ivec4> triangles;
  for (const glm::ivec3& t : mesh.triangles) triangles.emplace_back(t, 0);
  for (const CutMesh::Vertex& v : cut_.vertices) {
    const glm::ivec3& corners = mesh.triangles[std::size_t(v.triangle)];
    vertices.emplace_back(glm::vec3(v.position), v.weights.x);
    vertices.emplace_back(v.mean(corners, normal_.data()), v.weights.y);
    tangents.push_back(v.mean(corners, tangents.data()));
    uvs.push_back(v.mean(corners, uvs.data()));
  }
  if (!mesh.colors.empty()) {
    const glm::vec3* colors = mesh.colors.data();
    for (const glm::vec3& color : mesh.colors) vertices.emplace_back(color, 0);
    for (const CutMesh::Vertex& v : cut_.vertices)
      vertices.emplace_back(v.mean(mesh.triangles[std::size_t(v.triangle)], colors), 0);
  }
  for (const CutMesh::Triangle& t : cut_.triangles) triangles.emplace_back(t.corners, t.whole + 1);
  upload_table(gpu, vertices_, vertices);
  upload_table(gpu, tangents_, tangents);
  upload_table(gpu, uvs_, GL_RG32F, GL_RG, GL_FLOAT, uvs);
  upload_table(gpu, triangles_, GL_RGBA32I, GL_RGBA_INTEGER, GL_INT, triangles);
}

void MeshBuffers::upload_shares(Gpu& gpu, const Scene& scene, std::span<const glm::vec4> shares) {
  std::vector<glm::vec4> now(shares.begin(), shares.end());
  if (shares.empty())
    for (const float visibility : scene.visibility) now.emplace_back(glm::vec3(visibility), 1);
  if (same_bytes(now, share_)) return;
  share_.clear();  // until it is uploaded
  upload_share_table(gpu, mesh_, now);
  share_ = std::move(now);
}

void MeshBuffers::upload_share_table(Gpu& gpu, const Mesh& mesh,
                                     const std::vector<glm::vec4>& shares) {
  std::vector<glm::vec4> rows;
  const std::size_t own = mesh.vertices.size();
  for (std::size_t side = 0; side < shares.size(); side += own) {
    const glm::vec4* values = shares.data() + side;
    rows.insert(rows.end(), values, values + own);
    for (const CutMesh::Vertex& v : cut_.vertices)
      rows.push_back(v.mean(mesh.triangles[std::size_t(v.triangle)], values));
  }
  upload_table(gpu, shares_, rows);
}

void MeshBuffers::set_cut(Gpu& gpu, CutMesh cut) {
  const bool same = cut.vertices.empty() && cut_.vertices.empty();
  cut_ = std::move(cut);
  if (same) return;
  Mesh mesh;
  std::vector<glm::vec4> shares;
  std::swap(mesh, mesh_), std::swap(shares, share_);  // until it is uploaded
  upload_tables(gpu, mesh);
  upload_share_table(gpu, mesh, shares);
  std::swap(mesh, mesh_), std::swap(shares, share_);
}

void MeshBuffers::bind(Gpu& gpu) const {
  gpu.bind("triangles", triangles_);
  gpu.bind("vertices", vertices_);
  gpu.bind("shares", shares_);
}

void MeshBuffers::bind_uvs(Gpu& gpu) const {
  gpu.bind("tangents", tangents_);
  gpu.bind("uvs", uvs_);
}

MeshBuffers::Corners MeshBuffers::use(Gpu& gpu, const Camera& camera,
                                      const Pose& camera_from_object, bool all_before_camera) {
  const double least = least_bent_.of(camera);
  if (all_before_camera && !may_be_bent(mesh_, camera_from_object, least)) {
    set_cut(gpu, {});
    return {vertex_arrays_[0], corner_count_};
  }
  set_cut(gpu, cut_to_view(mesh_, ViewVolume(mesh_, camera, camera_from_object, least)));
  std::vector<Corner> corners;
  const auto add = [&](const glm::ivec3& index, std::size_t number) {
    for (int k = 0; k < 3; ++k) {
      const std::size_t i = std::size_t(index[k]), own = mesh_.vertices.size();
      corners.push_back({i < own ? mesh_.vertices[i] : glm::vec3(cut_.vertices[i - own].position),
                         GLuint(number)});
    }
  };
  for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
    if (!cut_.replaced[t]) add(mesh_.triangles[t], t + 1);
  for (std::size_t t = 0; t < cut_.triangles.size(); ++t)
    add(cut_.triangles[t].corners, mesh_.triangles.size() + t + 1);
  fill(buffers_[1], corners, GL_STREAM_DRAW);
  return {vertex_arrays_[1], int(corners.size())};
}

}  // namespace fastibl
