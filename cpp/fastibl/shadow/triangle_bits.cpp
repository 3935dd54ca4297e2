#include "fastibl/shadow/triangle_bits.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <unordered_map>

#include "fastibl/core/wide.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#endif

namespace fastibl {
namespace {

constexpr int kLow = 4;  // rows of triangles that are drawn side by side
// Texels. Keeps what is far away finite; a grid has fewer by far.
constexpr float kFar = 1e7f;

struct PlaceHash {
  std::size_t operator()(const glm::vec3& v) const {
    std::uint32_t bits[3];
    std::memcpy(bits, &v, sizeof bits);
    std::uint64_t h = 0x9e3779b97f4a7c15u;
    for (const std::uint32_t b : bits) h = (h ^ b) * 0xff51afd7ed558ccdu, h ^= h >> 32;
    return std::size_t(h);
  }
};

// Merges vertices, and cuts triangles at z = 0.
class Builder {
 public:
  int add(glm::vec3 v) {
    v += 0.0f;  // −0 and 0 are one place
    const auto [it, is_new] = index_.try_emplace(v, int(vertices.size()));
    if (is_new) vertices.push_back(v);
    return it->second;
  }
  // Where the edge between two vertices meets the plane; worked out once for both its triangles.
  int cut(int i, int j) {
    if (i > j) std::swap(i, j);
    const auto [it, is_new] = cuts_.try_emplace({i, j}, -1);
    if (is_new) {
      const glm::dvec3 p(vertices[std::size_t(i)]), q(vertices[std::size_t(j)]);
      glm::vec3 at(p + (q - p) * (p.z / (p.z - q.z)));
      at.z = 0;
      it->second = add(at);
    }
    return it->second;
  }
  void add_triangle(const int (&corner)[3]) {
    int polygon[4], count = 0;
    for (int k = 0; k < 3; ++k) {
      const int i = corner[k], j = corner[(k + 1) % 3];
      const float zi = vertices[std::size_t(i)].z, zj = vertices[std::size_t(j)].z;
      if (zi >= 0) polygon[count++] = i;
      if ((zi < 0 && zj > 0) || (zi > 0 && zj < 0)) polygon[count++] = cut(i, j);
    }
    for (int k = 2; k < count; ++k) keep(polygon[0], polygon[k - 1], polygon[k]);
  }
  std::vector<glm::vec3> vertices;
  std::vector<glm::ivec3> triangles;

 private:
  void keep(int a, int b, int c) {
    if (a == b || b == c || a == c) return;
    if (a > b) std::swap(a, b);
    if (b > c) std::swap(b, c);
    if (a > b) std::swap(a, b);
    triangles.push_back({a, b, c});
  }
  std::unordered_map<glm::vec3, int, PlaceHash> index_;
  std::map<std::pair<int, int>, int> cuts_;
};

// begin and end included; columns of 64 texels lie `stride` words apart.
inline void set_span(std::uint64_t* row, std::ptrdiff_t stride, int begin, int end) {
  const int first = begin >> 6, last = end >> 6;
  const std::uint64_t low = ~std::uint64_t{0} << (begin & 63),
                      high = ~std::uint64_t{0} >> (63 - (end & 63));
  if (first == last) {
    row[first * stride] |= low & high;
    return;
  }
  row[first * stride] |= low;
  for (int w = first + 1; w < last; ++w) row[w * stride] = ~std::uint64_t{0};
  row[last * stride] |= high;
}

struct Edge {
  float x, y, slope, low, high;  // low and high: y of the ends; low > high: horizontal, never met
  Edge(glm::vec2 p, glm::vec2 q)
      : x(p.x), y(p.y), slope(0), low(std::min(p.y, q.y)), high(std::max(p.y, q.y)) {
    if (low < high)
      slope = (q.x - p.x) / (q.y - p.y);
    else
      low = 1, high = 0;
  }
};

// a b c: corners, in an order in which two triangles have a shared edge alike, so that both find
// the same crossing with a row.
void draw_triangle(glm::vec2 a, glm::vec2 b, glm::vec2 c, int size, std::ptrdiff_t stride,
                   std::uint64_t* words) {
  const float last = float(size - 1);
  const int begin = int(std::ceil(std::max(std::min({a.y, b.y, c.y}), 0.0f))),
            end = int(std::floor(std::min(std::max({a.y, b.y, c.y}), last)));
  const Edge edges[3] = {{a, b}, {b, c}, {a, c}};
  for (int j = begin; j <= end; ++j) {
    const float y = float(j);
    float left = kFar, right = -kFar;
    for (const Edge& e : edges) {
      if (y < e.low || y > e.high) continue;
      const float x = e.x + (y - e.y) * e.slope;
      left = std::min(left, x), right = std::max(right, x);
    }
    left = std::max(left, 0.0f), right = std::min(right, last);
    if (!(left <= right)) continue;
    const int i0 = int(std::ceil(left)), i1 = int(std::floor(right));
    if (i0 <= i1) set_span(words + j, stride, i0, i1);
  }
}

#define FASTIBL_KERNEL "fastibl/shadow/triangle_kernel.inl"
#include "fastibl/core/kernel.inl"
FASTIBL_PICK(project);
FASTIBL_PICK(project_near);
FASTIBL_PICK(find_cells);
FASTIBL_PICK(find_met);
FASTIBL_PICK(draw_low);

}  // namespace

ShadowTriangles::ShadowTriangles(const Mesh& mesh) : ShadowTriangles(mesh, Pose{}) {}

ShadowTriangles::ShadowTriangles(const Mesh& mesh, const Pose& marker_from_mesh) {
  mesh.validate();
  Builder builder;
  std::vector<int> places;
  places.reserve(mesh.vertices.size());
  for (const glm::vec3& v : mesh.vertices)
    places.push_back(builder.add(glm::vec3(marker_from_mesh * glm::dvec3(v))));
  for (const glm::ivec3& t : mesh.triangles) {
    const int corner[3] = {places[std::size_t(t.x)], places[std::size_t(t.y)],
                           places[std::size_t(t.z)]};
    builder.add_triangle(corner);
  }
  // Vertices in the order of their use, so that neighbours lie together; the order of an edge's two
  // ends stays one for all its triangles.
  std::vector<int> number(builder.vertices.size(), -1);
  for (const glm::ivec3& t : builder.triangles) {
    int corner[3];
    for (int k = 0; k < 3; ++k) {
      const int v = t[k];
      if (number[std::size_t(v)] < 0) {
        number[std::size_t(v)] = int(x_.size());
        const glm::vec3& p = builder.vertices[std::size_t(v)];
        x_.push_back(p.x), y_.push_back(p.y), z_.push_back(p.z);
      }
      corner[k] = number[std::size_t(v)];
    }
    std::sort(corner, corner + 3);
    a_.push_back(corner[0]), b_.push_back(corner[1]), c_.push_back(corner[2]);
  }
  find_box();
}

void ShadowTriangles::find_box() {
  if (x_.empty()) return;
  const auto [x0, x1] = std::minmax_element(x_.begin(), x_.end());
  const auto [y0, y1] = std::minmax_element(y_.begin(), y_.end());
  const auto [z0, z1] = std::minmax_element(z_.begin(), z_.end());
  box_ = {{*x0, *y0, *z0}, {*x1, *y1, *z1}};
}

ShadowTriangles ShadowTriangles::moved(const PlaneMotion& motion) const {
  ShadowTriangles out = *this;
  for (std::size_t i = 0; i < x_.size(); ++i) {
    const glm::vec2 p = motion * glm::vec2(x_[i], y_[i]);
    out.x_[i] = p.x, out.y_[i] = p.y;
  }
  out.find_box();
  return out;
}

namespace {

constexpr float kTop = 1 - 1e-3f;  // of a near light's height

glm::vec2 thrown(glm::vec3 v, const PlaneProjection& light) {
  return (glm::vec2(v) - v.z * light.slope) / (1 - v.z * light.inverse_height);
}

// The part of a triangle up to z = top: a polygon of up to four corners. Returns their number.
int cut_above(const glm::vec3 (&corner)[3], float top, glm::vec3 (&polygon)[4]) {
  int count = 0;
  for (int k = 0; k < 3; ++k) {
    const glm::vec3 p = corner[k], q = corner[(k + 1) % 3];
    if (p.z <= top) polygon[count++] = p;
    if ((p.z <= top) != (q.z <= top)) polygon[count++] = p + (q - p) * ((top - p.z) / (q.z - p.z));
  }
  return count;
}

}  // namespace

void ShadowTriangles::draw_cut(std::size_t triangle, float top, const PlaneProjection& light,
                               const PlaneGrid& grid, PlaneBits& bits) const {
  const auto at = [&](std::int32_t i) {
    const std::size_t v = std::size_t(i);
    return glm::vec3(x_[v], y_[v], z_[v]);
  };
  const glm::vec3 corner[3] = {at(a_[triangle]), at(b_[triangle]), at(c_[triangle])};
  glm::vec3 polygon[4];
  const int count = cut_above(corner, top, polygon);
  glm::vec2 on_grid[4];
  for (int k = 0; k < count; ++k)
    on_grid[k] =
        glm::clamp(glm::vec2(grid.texels(glm::dvec2(thrown(polygon[k], light)))), -kFar, kFar);
  for (int k = 2; k < count; ++k)
    draw_triangle(on_grid[0], on_grid[k - 1], on_grid[k], bits.size(), bits.padded_rows(),
                  bits.column(0));
}

void ShadowTriangles::draw(const PlaneProjection& light, const PlaneGrid& grid, PlaneBits& bits,
                           Scratch& scratch) const {
  if (bits.size() == 0 || a_.empty()) return;
  const int count = int(a_.size());
  scratch.places.resize(x_.size());
  scratch.cells.resize(x_.size());
  scratch.low.resize(a_.size() + kWide), scratch.tall.resize(a_.size() + kWide);
  const float scale = float(1 / grid.texel());
  const glm::vec2 slope = light.slope, shift(grid.texels({0, 0}));
  const bool near_light = light.inverse_height > 0;
  const float top = near_light ? kTop / light.inverse_height : 0;
  float* places = &scratch.places.data()->x;
  if (near_light)
    project_near(x_.data(), y_.data(), z_.data(), int(x_.size()), &slope.x, &shift.x, scale, top,
                 light.inverse_height, places);
  else
    project(x_.data(), y_.data(), z_.data(), int(x_.size()), &slope.x, &shift.x, scale, places);
  const float last = float(bits.size() - 1);
  int low = 0, tall = 0;
  find_cells(places, int(x_.size()), last, scratch.cells.data());
  find_met(a_.data(), b_.data(), c_.data(), count, scratch.cells.data(), scratch.low.data(),
           scratch.tall.data(), &low, &tall);
  if (near_light && box_.upper.z > top) {
    const auto higher = [&](std::int32_t triangle) {
      const auto k = std::size_t(triangle);
      return std::max({z_[std::size_t(a_[k])], z_[std::size_t(b_[k])], z_[std::size_t(c_[k])]}) >
             top;
    };
    for (int k = 0; k < count; ++k)
      if (higher(k)) draw_cut(std::size_t(k), top, light, grid, bits);
    const auto keep = [&](std::vector<std::int32_t>& chosen, int& number) {
      number =
          int(std::remove_if(chosen.begin(), chosen.begin() + number, higher) - chosen.begin());
    };
    keep(scratch.low, low), keep(scratch.tall, tall);
  }
  for (int i = 0; i < tall; ++i) {
    const auto k = std::size_t(scratch.tall[std::size_t(i)]);
    const auto at = [&](std::int32_t v) { return scratch.places[std::size_t(v)]; };
    draw_triangle(at(a_[k]), at(b_[k]), at(c_[k]), bits.size(), bits.padded_rows(), bits.column(0));
  }
  draw_low(scratch.low.data(), low, a_.data(), b_.data(), c_.data(), places, last,
           bits.padded_rows(), bits.column(0));
}

}  // namespace fastibl
