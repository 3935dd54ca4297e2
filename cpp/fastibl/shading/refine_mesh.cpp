#include "fastibl/shading/refine_mesh.h"

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <utility>

#include "fastibl/scene/octahedral.h"
#include "fastibl/shading/bake_visibility.h"

namespace fastibl {
namespace {

constexpr int kRays = 16, kSky = 8;  // cells along an edge: of rays, and of what is compared
constexpr int kSkyCells = kSky * kSky;
constexpr float kShortest = 1 / 300.0f;  // edge that is split, by the mesh's size
constexpr float kShort = 1 / 60.0f;      // edge on which nothing is missed where its ends agree
constexpr float kLongest = 1 / 8.0f;     // edge that is kept whatever its ends see
constexpr int kRounds = 7;

using Sky = std::array<float, kSkyCells>;  // share of each cell that is free
using Edge = std::pair<int, int>;          // smaller index first

Edge edge_of(int a, int b) { return {std::min(a, b), std::max(a, b)}; }

std::vector<Sky> skies_of(const VertexVisibility& visibility) {
  constexpr int kParts = kRays * kRays / kSkyCells;
  std::vector<Sky> skies(visibility.entries());
  for (std::size_t i = 0; i < skies.size(); ++i) {
    skies[i].fill(1);
    for (std::uint32_t e = visibility.first[i]; e < visibility.first[i + 1]; e += 2)
      for (int k = visibility.edges[e]; k < int(visibility.edges[e + 1]); ++k)
        skies[i][std::size_t(k / kParts)] -= 1.0f / kParts;
  }
  return skies;
}

// Mean square of what is missed between a and b, weighted by cosine. Where a cell lies below an
// end's horizon, the other end counts.
float missed(const Sky& middle, glm::vec3 normal, const Sky& a, glm::vec3 normal_a, const Sky& b,
             glm::vec3 normal_b) {
  const std::vector<glm::vec3>& directions = octahedral_grid(kSky).directions();
  float sum = 0, weights = 0;
  for (std::size_t k = 0; k < directions.size(); ++k) {
    const float w = std::max(glm::dot(normal, directions[k]), 0.0f);
    const float wa = std::max(glm::dot(normal_a, directions[k]), 0.0f),
                wb = std::max(glm::dot(normal_b, directions[k]), 0.0f);
    if (!(w > 0) || !(wa + wb > 0)) continue;
    const float off = middle[k] - (wa * a[k] + wb * b[k]) / (wa + wb);
    sum += w * off * off, weights += w;
  }
  return weights > 0 ? sum / weights : 0.0f;
}

class Refiner {
 public:
  Refiner(const Mesh& mesh, const Bvh& bvh, const MeshRefineOptions& options,
          const Progress& progress)
      : base_(mesh), options_(options), bvh_(bvh), progress_(progress) {
    refined_.mesh = mesh;
    refined_.mesh.normals = base_.normals = vertex_normals(mesh);
    const Bounds box = bounds(mesh.vertices);
    const glm::vec3 extent = box.upper - box.lower;
    size_ = std::max({extent.x, extent.y, extent.z});
    offset_ = ray_offset(mesh);
    for (std::size_t i = 0; i < mesh.vertices.size(); ++i) add_place(int(i));
    refined_.origins = refined_.back_origins = mesh.vertices;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      base_triangle_.push_back(int(t));
      area_ += double(area(mesh.triangles[t]));
    }
  }

  RefinedMesh run() {
    if (!(area_ > 0)) return std::move(refined_);
    // Every edge may miss its share of what all may miss; there are some thousand of them.
    constexpr float kEdges = 3000;
    least_ = options_.error * options_.error * float(area_) / kEdges;
    look(0);
    for (round_ = 1; round_ <= kRounds; ++round_) {
      find_candidates();
      if (!choose()) break;
      split();
    }
    return std::move(refined_);
  }

 private:
  // The middle of an edge, which may become a vertex.
  struct Middle {
    int a, b;  // vertices, of one triangle
    glm::vec3 point, normal, origin, back_origin;
    Edge places;
    float length, area;  // of the edge; a third of its triangles'
    float error = 0;     // times area
  };

  float area(glm::ivec3 t) const {
    const std::vector<glm::vec3>& v = refined_.mesh.vertices;
    return 0.5f * glm::length(glm::cross(v[std::size_t(t[1])] - v[std::size_t(t[0])],
                                         v[std::size_t(t[2])] - v[std::size_t(t[0])]));
  }

  void add_place(int vertex) {
    const glm::vec3& p = refined_.mesh.vertices[std::size_t(vertex)];
    place_.push_back(places_.try_emplace({p.x, p.y, p.z}, int(places_.size())).first->second);
  }

  // The point on the round surface over a triangle of the mesh. side: 1, or −1 for its back.
  glm::vec3 lifted(int triangle, glm::vec3 p, float side) const {
    const glm::ivec3 t = base_.triangles[std::size_t(triangle)];
    const glm::vec3 corner[3] = {base_.vertices[std::size_t(t[0])],
                                 base_.vertices[std::size_t(t[1])],
                                 base_.vertices[std::size_t(t[2])]};
    const glm::vec3 across = glm::cross(corner[1] - corner[0], corner[2] - corner[0]);
    const float whole = glm::dot(across, across);
    glm::vec3 result = p;
    if (!(whole > 0)) return result;
    for (int i = 0; i < 3; ++i) {
      const glm::vec3 &b = corner[(i + 1) % 3], &c = corner[(i + 2) % 3];
      const float w = std::clamp(glm::dot(glm::cross(b - p, c - p), across) / whole, 0.0f, 1.0f);
      const glm::vec3 n = side * base_.normals[std::size_t(t[i])];
      result -= w * std::min(glm::dot(p - corner[i], n), 0.0f) * n;
    }
    return result;
  }

  // begin, end: part of the round.
  std::vector<Sky> seen(const std::vector<glm::vec3>& origins,
                        const std::vector<glm::vec3>& normals, float side, float begin,
                        float end) const {
    std::vector<glm::vec3> turned;
    for (const glm::vec3& n : normals) turned.push_back(side * n);
    constexpr float kAll = kRounds + 1;
    const Progress progress =
        part_of(progress_, (float(round_) + begin) / kAll, (float(round_) + end) / kAll);
    return skies_of(visibility_at(bvh_, offset_, origins, turned, kRays, progress));
  }

  // The skies of vertices from `first` on.
  void look(std::size_t first) {
    const auto from = std::ptrdiff_t(first);
    const std::vector<glm::vec3> normals(refined_.mesh.normals.begin() + from,
                                         refined_.mesh.normals.end());
    const std::vector<Sky> front =
        seen({refined_.origins.begin() + from, refined_.origins.end()}, normals, 1, 0.6f, 0.8f);
    front_.insert(front_.end(), front.begin(), front.end());
    if (!options_.backs) return;
    const std::vector<Sky> back = seen(
        {refined_.back_origins.begin() + from, refined_.back_origins.end()}, normals, -1, 0.8f, 1);
    back_.insert(back_.end(), back.begin(), back.end());
  }

  // Edges, by place, that are to be looked at. All edges that lie there are then looked at, so that
  // none is left whole beside one that is split.
  std::set<Edge> doubtful_places() const {
    std::set<Edge> doubtful;
    for (const glm::ivec3& t : refined_.mesh.triangles)
      for (int k = 0; k < 3; ++k) {
        const std::size_t a = std::size_t(t[k]), b = std::size_t(t[(k + 1) % 3]);
        const float length = glm::length(refined_.mesh.vertices[a] - refined_.mesh.vertices[b]);
        if (!(length > kShortest * size_)) continue;
        const Edge places = edge_of(place_[a], place_[b]);
        if (kept_.contains(places) || doubtful.contains(places)) continue;
        if (length >= kShort * size_ || !ends_agree(a, b, area(t) / 3)) doubtful.insert(places);
      }
    return doubtful;
  }

  // Middles of edges that were not looked at before, with what is missed there.
  void find_candidates() {
    const Mesh& mesh = refined_.mesh;
    const std::set<Edge> doubtful = doubtful_places();
    std::map<Edge, std::size_t> found;
    candidates_.clear();
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
      for (int k = 0; k < 3; ++k) {
        const Edge edge = edge_of(mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]);
        const std::size_t a = std::size_t(edge.first), b = std::size_t(edge.second);
        const Edge places = edge_of(place_[a], place_[b]);
        if (!doubtful.contains(places)) continue;
        const float length = glm::length(mesh.vertices[a] - mesh.vertices[b]);
        const float part = area(mesh.triangles[t]) / 3;
        const auto [at, is_new] = found.try_emplace(edge, candidates_.size());
        if (!is_new) {
          candidates_[at->second].area += part;
          continue;
        }
        Middle m{edge.first, edge.second, {}, {}, {}, {}, places, length, part};
        m.point = 0.5f * (mesh.vertices[a] + mesh.vertices[b]);
        const glm::vec3 n = mesh.normals[a] + mesh.normals[b];
        m.normal = glm::dot(n, n) > 1e-12f ? glm::normalize(n) : mesh.normals[a];
        m.origin = lifted(base_triangle_[t], m.point, 1);
        m.back_origin = lifted(base_triangle_[t], m.point, -1);
        candidates_.push_back(m);
      }
    std::vector<glm::vec3> origins, back_origins, normals;
    for (const Middle& m : candidates_)
      origins.push_back(m.origin), back_origins.push_back(m.back_origin),
          normals.push_back(m.normal);
    judge(seen(origins, normals, 1, 0, 0.3f), front_, 1);
    if (options_.backs) judge(seen(back_origins, normals, -1, 0.3f, 0.6f), back_, -1);
  }

  bool ends_agree(std::size_t a, std::size_t b, float part) const {
    const std::vector<glm::vec3>& n = refined_.mesh.normals;
    float off = missed(front_[a], n[a], front_[b], n[b], front_[b], n[b]);
    if (options_.backs) off += missed(back_[a], -n[a], back_[b], -n[b], back_[b], -n[b]);
    return 2 * part * off < least_;
  }

  void judge(const std::vector<Sky>& middles, const std::vector<Sky>& ends, float side) {
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      Middle& m = candidates_[i];
      const std::size_t a = std::size_t(m.a), b = std::size_t(m.b);
      const std::vector<glm::vec3>& n = refined_.mesh.normals;
      m.error +=
          m.area * missed(middles[i], side * m.normal, ends[a], side * n[a], ends[b], side * n[b]);
    }
  }

  // Edges to split, by place: those of the largest errors, as many as there may be vertices.
  bool choose() {
    struct Wanted {
      float error = 0;
      std::size_t vertices = 0;  // at its middle: as many as there are edges there
    };
    std::map<Edge, Wanted> by_place;
    for (const Middle& m : candidates_) {
      Wanted& wanted = by_place[m.places];
      const bool is_long = m.length > kLongest * size_;
      wanted.error = std::max(wanted.error, is_long ? m.error + 2 * least_ : m.error);
      ++wanted.vertices;
    }
    std::vector<std::pair<Edge, Wanted>> wanted;
    for (const auto& edge : by_place) {
      if (edge.second.error > least_)
        wanted.push_back(edge);
      else
        kept_.insert(edge.first);
    }
    std::stable_sort(wanted.begin(), wanted.end(),
                     [](const auto& a, const auto& b) { return a.second.error > b.second.error; });
    std::size_t room = std::size_t(options_.most_vertices) - refined_.mesh.vertices.size();
    chosen_.clear();
    for (const auto& [places, edge] : wanted) {
      if (edge.vertices > room) break;
      chosen_.insert(places);
      room -= edge.vertices;
    }
    return !chosen_.empty();
  }

  // The vertex in the middle of an edge; −1 where it is not split.
  int middle_of(int a, int b) {
    const auto at = middles_.find(edge_of(a, b));
    return at == middles_.end() ? -1 : at->second;
  }

  void split() {
    Mesh& mesh = refined_.mesh;
    const std::size_t first = mesh.vertices.size();
    middles_.clear();
    for (const Middle& m : candidates_) {
      if (!chosen_.contains(m.places)) continue;
      const std::size_t a = std::size_t(m.a), b = std::size_t(m.b);
      middles_[{m.a, m.b}] = int(mesh.vertices.size());
      mesh.vertices.push_back(m.point), mesh.normals.push_back(m.normal);
      if (!mesh.uvs.empty()) mesh.uvs.push_back(0.5f * (mesh.uvs[a] + mesh.uvs[b]));
      if (!mesh.colors.empty()) mesh.colors.push_back(0.5f * (mesh.colors[a] + mesh.colors[b]));
      refined_.origins.push_back(m.origin), refined_.back_origins.push_back(m.back_origin);
      refined_.parents.emplace_back(m.a, m.b);
      add_place(int(mesh.vertices.size()) - 1);
    }
    const std::vector<glm::ivec3> before = std::move(mesh.triangles);
    const std::vector<int> base = std::move(base_triangle_);
    mesh.triangles.clear(), base_triangle_.clear();
    for (std::size_t t = 0; t < before.size(); ++t) split_triangle(before[t], base[t]);
    look(first);
  }

  void add_triangle(int a, int b, int c, int base) {
    refined_.mesh.triangles.emplace_back(a, b, c);
    base_triangle_.push_back(base);
  }

  void split_triangle(glm::ivec3 t, int base) {
    int middle[3], count = 0;
    for (int k = 0; k < 3; ++k) {
      middle[k] = middle_of(t[k], t[(k + 1) % 3]);
      count += middle[k] >= 0;
    }
    if (count == 0) return add_triangle(t[0], t[1], t[2], base);
    if (count == 3) {
      for (int k = 0; k < 3; ++k) add_triangle(t[k], middle[k], middle[(k + 2) % 3], base);
      return add_triangle(middle[0], middle[1], middle[2], base);
    }
    // Turned so that the first edge is split and, where two are, the last is whole.
    int k = 0;
    while (middle[k] < 0 || (count == 2 && middle[(k + 2) % 3] >= 0)) ++k;
    const int a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3], ab = middle[k];
    if (count == 1) {
      add_triangle(a, ab, c, base), add_triangle(ab, b, c, base);
      return;
    }
    const int bc = middle[(k + 1) % 3];
    const std::vector<glm::vec3>& v = refined_.mesh.vertices;
    const auto distance = [&](int i, int j) {
      return glm::length(v[std::size_t(i)] - v[std::size_t(j)]);
    };
    add_triangle(ab, b, bc, base);
    if (distance(a, bc) < distance(ab, c))
      add_triangle(a, ab, bc, base), add_triangle(a, bc, c, base);
    else
      add_triangle(a, ab, c, base), add_triangle(ab, bc, c, base);
  }

  Mesh base_;
  MeshRefineOptions options_;
  const Bvh& bvh_;
  const Progress& progress_;
  int round_ = 0;
  float size_ = 0, offset_ = 0;
  double area_ = 0;
  float least_ = 0;  // error times area for which an edge is split
  RefinedMesh refined_;
  std::vector<Sky> front_, back_;               // of the vertices
  std::vector<int> base_triangle_;              // of each triangle
  std::map<std::array<float, 3>, int> places_;  // vertices at one place have one number
  std::vector<int> place_;                      // of each vertex
  std::set<Edge> kept_, chosen_;                // edges by place
  std::map<Edge, int> middles_;                 // by vertices
  std::vector<Middle> candidates_;
};

}  // namespace

RefinedMesh refine(const Mesh& mesh, const Bvh& bvh, const MeshRefineOptions& options,
                   const Progress& progress) {
  if (int(mesh.vertices.size()) >= options.most_vertices)
    return {mesh, mesh.vertices, mesh.vertices, {}};
  return Refiner(mesh, bvh, options, progress).run();
}

}  // namespace fastibl
