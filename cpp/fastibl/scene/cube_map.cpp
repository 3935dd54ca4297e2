#include "fastibl/scene/cube_map.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <random>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

// ∫∫ dx dy / (1 + x² + y²)^{3/2} over [0, x] × [0, y]: the solid angle of a rectangle on the face
// plane.
double corner_angle(double x, double y) {
  return std::atan2(x * y, std::sqrt(x * x + y * y + 1.0));
}

// Where the texels across an edge of a face lie: at start + i · step on the adjacent face; the
// start is in units of the last texel's index.
struct EdgeNeighbour {
  int face, start_x, start_y, step_x, step_y;
  CubeEdge edge;  // of that face
};
using enum CubeEdge;

// Folds the directions of imagined texels beyond the edge onto the neighbour. This is exact,
// because both faces divide an edge into the same parts.
EdgeNeighbour find_neighbour(int face, CubeEdge edge) {
  constexpr int n = 4;
  const auto across = [&](int i) {
    const float s = edge == left ? -1e-4f : edge == right ? 1 + 1e-4f : (float(i) + 0.5f) / n;
    const float t = edge == top ? -1e-4f : edge == bottom ? 1 + 1e-4f : (float(i) + 0.5f) / n;
    const TexelPlace p = texel_at(face_direction(face, s, t), n);
    return std::array{p.face, p.x, p.y};
  };
  const auto first = across(0), second = across(1);
  EdgeNeighbour found{
      first[0], first[1] / (n - 1), first[2] / (n - 1), second[1] - first[1], second[2] - first[2],
      top};
  if (found.step_x == 0)
    found.edge = found.start_x == 0 ? left : right;
  else
    found.edge = found.start_y == 0 ? top : bottom;
  return found;
}

const std::array<std::array<EdgeNeighbour, 4>, 6>& edge_neighbours() {
  static const auto table = [] {
    std::array<std::array<EdgeNeighbour, 4>, 6> all{};
    for (int f = 0; f < 6; ++f)
      for (const CubeEdge edge : {top, bottom, left, right})
        all[std::size_t(f)][std::size_t(edge)] = find_neighbour(f, edge);
    return all;
  }();
  return table;
}

}  // namespace

FacePoint face_point(glm::vec3 d) {
  const glm::vec3 a = glm::abs(d);
  int face;
  float s, t, major;
  if (a.x >= a.y && a.x >= a.z) {
    face = d.x > 0 ? 0 : 1, major = a.x, s = d.x > 0 ? -d.z : d.z, t = -d.y;
  } else if (a.y >= a.z) {
    face = d.y > 0 ? 2 : 3, major = a.y, s = d.x, t = d.y > 0 ? d.z : -d.z;
  } else {
    face = d.z > 0 ? 4 : 5, major = a.z, s = d.z > 0 ? d.x : -d.x, t = -d.y;
  }
  const float scale = 0.5f / major;
  return {face, s * scale + 0.5f, t * scale + 0.5f};
}

glm::vec3 face_direction(int face, float s, float t) {
  const float a = 2 * s - 1, b = 2 * t - 1;
  switch (face) {
    case 0:
      return {1, -b, -a};
    case 1:
      return {-1, -b, a};
    case 2:
      return {a, 1, b};
    case 3:
      return {a, -1, -b};
    case 4:
      return {a, -b, 1};
    default:
      return {-a, -b, -1};
  }
}

double texel_solid_angle(int x, int y, int size) {
  const double x0 = 2.0 * x / size - 1, x1 = 2.0 * (x + 1) / size - 1;
  const double y0 = 2.0 * y / size - 1, y1 = 2.0 * (y + 1) / size - 1;
  return corner_angle(x0, y0) - corner_angle(x0, y1) - corner_angle(x1, y0) + corner_angle(x1, y1);
}

std::vector<double> texel_solid_angles(int size) {
  const int n = size;
  std::vector<double> corners(std::size_t(n + 1) * std::size_t(n + 1)), angles(std::size_t(n) * n);
  const auto corner = [&](int x, int y) -> double& {
    return corners[std::size_t(y) * std::size_t(n + 1) + std::size_t(x)];
  };
  // corner_angle() is odd in both coordinates and symmetric in them, so an eighth is computed.
  for (int y = (n + 1) / 2; y <= n; ++y)
    for (int x = y; x <= n; ++x) {
      const double value = corner_angle(2.0 * x / n - 1, 2.0 * y / n - 1);
      for (const auto& [u, v] : {std::pair{x, y}, std::pair{y, x}}) {
        corner(u, v) = corner(n - u, n - v) = value;
        corner(n - u, v) = corner(u, n - v) = -value;
      }
    }
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const double* c = &corners[std::size_t(y) * (n + 1) + std::size_t(x)];
      angles[std::size_t(y) * n + std::size_t(x)] = c[0] - c[1] - c[n + 1] + c[n + 2];
    }
  return angles;
}

CubeLevel::CubeLevel(int size)
    : size_(size), texels_(6 * std::size_t(size + 2) * std::size_t(size + 2) + 1, glm::vec3(0)) {}

void CubeLevel::update_border(unsigned edges) {
  const int n = size_;
  const std::ptrdiff_t stride = row_stride();
  for (int f = 0; f < 6; ++f) {
    unsigned touched = edges >> 4 * f & 15;
    for (const CubeEdge edge : {top, bottom, left, right}) {
      const EdgeNeighbour& other = edge_neighbours()[std::size_t(f)][std::size_t(edge)];
      if (!(edges >> (4 * other.face + int(other.edge)) & 1)) continue;
      touched = 1;
      const glm::vec3* from = &texel(other.face, other.start_x * (n - 1), other.start_y * (n - 1));
      const std::ptrdiff_t from_step = other.step_x + other.step_y * stride;
      glm::vec3* to = &texel(f,
                             edge == left    ? -1
                             : edge == right ? n
                                             : 0,
                             edge == top      ? -1
                             : edge == bottom ? n
                                              : 0);
      const std::ptrdiff_t to_step = edge == top || edge == bottom ? 1 : stride;
      for (int i = 0; i < n; ++i, from += from_step, to += to_step) *to = *from;
    }
    if (!touched) continue;
    for (const int y : {-1, n})
      for (const int x : {-1, n}) {
        const int ix = x < 0 ? 0 : n - 1, iy = y < 0 ? 0 : n - 1;
        texel(f, x, y) = (texel(f, ix, iy) + texel(f, ix, y) + texel(f, x, iy)) / 3.0f;
      }
  }
}

// Four floats from a texel on: its three channels and the float that follows.
typedef float Four __attribute__((vector_size(16)));
inline Four four(const glm::vec3* texel) {
  Four v;
  std::memcpy(&v, texel, sizeof v);
  return v;
}

glm::vec3 CubeLevel::sample(glm::vec3 direction) const { return sample(face_point(direction)); }

glm::vec3 CubeLevel::sample(const FacePoint& p) const {
  // Clamped, because a direction of length 0 or NaN gives a NaN point: such a look-up is defined,
  // though not useful. Comparisons are used because fmin and fmax are library calls.
  const float limit = float(size_);
  const auto clamped = [limit](float v) {
    return v > -0.5f ? (v < limit - 0.5f ? v : limit - 0.5f) : -0.5f;
  };
  const float x = clamped(p.s * limit - 0.5f), y = clamped(p.t * limit - 0.5f);
  const int ix = int(x + 1) - 1, iy = int(y + 1) - 1;  // floor for x ≥ −1
  // Just below a whole number, x + 1 is rounded up to the next one.
  const auto share = [](float v) { return v > 0 ? v : 0.0f; };
  const float fx = share(x - float(ix)), fy = share(y - float(iy));
  const glm::vec3* a = &texel(p.face, ix, iy);
  const glm::vec3* b = a + row_stride();
  const Four a0 = four(a), b0 = four(b);
  const Four upper = a0 + fx * (four(a + 1) - a0), lower = b0 + fx * (four(b + 1) - b0);
  const Four value = upper + fy * (lower - upper);
  return {value[0], value[1], value[2]};
}

float clean_radiance(float value, CleaningStatistics& statistics) {
  if (value >= 0 && value <= kRadianceCap) return value;
  if (std::isnan(value)) {
    ++statistics.nan;
    return 0;
  }
  if (value < 0) {
    ++statistics.negative;
    return 0;
  }
  ++statistics.capped;
  return kRadianceCap;
}

namespace {

// Without a branch, so that it is vectorised.
FASTIBL_CLONES int any_unclean(const float* values, int count) {
  int bad = 0;
  for (int i = 0; i < count; ++i) bad |= !(values[i] >= 0 && values[i] <= kRadianceCap);
  return bad;
}

}  // namespace

bool all_clean(const float* values, int count) { return any_unclean(values, count) == 0; }

std::uint64_t new_tile_version() {
  // Two copies of this library in one program, as in plugins, must not give the same numbers.
  static std::atomic<std::uint64_t> last{std::uint64_t{std::random_device{}()} << 32};
  return ++last;
}

CubeMap::CubeMap(int size) {
  check(size >= 1, "faces must be at least 1 texel wide, got ", size);
  for (int n = size;; n /= 2) {
    levels_.emplace_back(n);
    if (n == 1) break;
    reductions_.push_back(CubeReduction::of(n));
  }
  versions_.assign(std::size_t(tiles().count()), new_tile_version());
}

CubeMap::CubeMap(int size, std::span<const glm::vec3> faces) : CubeMap(size) {
  check(faces.size() == 6 * std::size_t(size) * std::size_t(size), "a cube map of size ", size,
        " needs ", 6 * std::size_t(size) * std::size_t(size), " texels, got ", faces.size());
  const glm::vec3* in = faces.data();
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < size; ++y, in += size) {
      std::copy(in, in + size, &base().texel(f, 0, y));
      clean_row(f, y);
    }
  update();
}

void CubeMap::clean_row(int face, int y) {
  glm::vec3* row = &base().texel(face, 0, y);
  if (all_clean(&row->x, 3 * size())) return;
  for (int x = 0; x < size(); ++x)
    for (int c = 0; c < 3; ++c) row[x][c] = clean_radiance(row[x][c], cleaned_);
}

void CubeMap::update() {
  std::vector<FaceRect> all;  // faces side by side: they share their weights
  for (int row = 0; row < tiles().per_edge(); ++row)
    for (int f = 0; f < 6; ++f)
      all.push_back({f, 0, tiles().begin(row), size(), tiles().begin(row + 1)});
  std::fill(versions_.begin(), versions_.end(), new_tile_version());
  update_levels(std::move(all), 1);
}

void CubeMap::update(std::span<const int> changed) { update(changed, 1); }

void CubeMap::update(std::span<const int> changed, int written) {
  const std::uint64_t version = new_tile_version();
  std::vector<FaceRect> runs;  // of tiles side by side
  for (const int tile : changed) {
    const FaceRect r = tile_rect(tiles(), tile);
    versions_[std::size_t(tile)] = version;
    FaceRect* last = runs.empty() ? nullptr : &runs.back();
    if (last && last->face == r.face && last->y0 == r.y0 && last->x1 == r.x0)
      last->x1 = r.x1;
    else
      runs.push_back(r);
  }
  update_levels(std::move(runs), written);
}

namespace {

// The edges that these rectangles touch, on faces of n texels.
unsigned edges_of(const std::vector<FaceRect>& rects, int n) {
  unsigned edges = 0;
  for (const FaceRect& r : rects) {
    const unsigned own = unsigned(r.y0 == 0) << int(top) | unsigned(r.y1 == n) << int(bottom) |
                         unsigned(r.x0 == 0) << int(left) | unsigned(r.x1 == n) << int(right);
    edges |= own << 4 * r.face;
  }
  return edges;
}

}  // namespace

// Works level by level: a texel made from both sides of a rectangle's edge needs both done.
void CubeMap::update_levels(std::vector<FaceRect> changed, int written) {
  if (changed.empty()) return;
  unsigned faces = 0;
  for (const FaceRect& r : changed) faces |= 1u << r.face;
  levels_[0].update_border(edges_of(changed, size()));
  bool whole = false;
  for (std::size_t k = 0; k + 1 < levels_.size(); ++k) {
    for (FaceRect& r : changed) r = reductions_[k]->reached(r);
    const int coarse = levels_[k + 1].size();
    if (!whole && coarse < TileGrid::kMost) {  // tiles share texels from here on
      changed.clear();
      for (int f = 0; f < 6; ++f)
        if (faces >> f & 1) changed.push_back({f, 0, 0, coarse, coarse});
      whole = true;
    }
    if (int(k) + 1 >= written)
      for (const FaceRect& r : changed) reductions_[k]->reduce(levels_[k], r, levels_[k + 1]);
    levels_[k + 1].update_border(edges_of(changed, coarse));
  }
  // A value that is not finite reaches the top level.
  bool finite = true;
  for (int f = 0; f < 6; ++f) {
    const glm::vec3& top = levels_.back().texel(f, 0, 0);
    finite &= std::isfinite(top.x + top.y + top.z);
  }
  if (finite) return;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < size(); ++y) clean_row(f, y);
  update();
}

CubeLevel& CubeMap::base() {
  check(!levels_.empty(), "a map without a size has no levels to write");
  return levels_[0];
}

const CubeLevel& CubeMap::level_at_most(int size) const {
  check(!levels_.empty(), "an empty map has no levels");
  for (const CubeLevel& level : levels_)
    if (level.size() <= size) return level;
  return levels_.back();
}

glm::vec3 CubeMap::sample(glm::vec3 direction, float level) const {
  check(!levels_.empty(), "an empty map cannot be looked up");
  const float top = float(level_count() - 1);
  const float clamped = level > 0 ? (level < top ? level : top) : 0.0f;  // NaN gives 0
  const int k = std::min(int(clamped), level_count() - 1);
  const float f = clamped - float(k);
  const FacePoint at = face_point(direction);
  const glm::vec3 fine = levels_[std::size_t(k)].sample(at);
  if (f == 0) return fine;
  return fine + f * (levels_[std::size_t(k) + 1].sample(at) - fine);
}

glm::dvec3 CubeMap::mean() const {
  check(!levels_.empty(), "an empty map has no mean");
  return levels_.front().mean();
}

glm::dvec3 CubeLevel::mean() const {
  glm::dvec3 sum(0);
  const std::vector<double> angle = texel_solid_angles(size_);
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < size_; ++y) {
      const double* a = &angle[std::size_t(y) * std::size_t(size_)];
      const glm::vec3* row = &texel(f, 0, y);
      glm::dvec3 part[4] = {};  // side by side: additions do not wait for each other
      for (int x = 0; x < size_; ++x) part[x & 3] += a[x] * glm::dvec3(row[x]);
      sum += part[0] + part[1] + (part[2] + part[3]);
    }
  return sum / (4 * std::numbers::pi);
}

}  // namespace fastibl
