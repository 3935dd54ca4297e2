#include "fastibl/shading/self_shadow.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/octahedral.h"

namespace fastibl {
namespace {

constexpr int kLevelSize = 32;  // of the map, whose texels are as wide as the finest cells
constexpr int kGrain = 512;     // vertices

// Adds up the runs of each vertex, and turns them into the light that falls on it.
FASTIBL_CLONES void add_runs(const std::uint32_t* first, const std::uint16_t* edges,
                             const float* sums, const float* normals, int count, float* blocked) {
  for (int i = 0; i < count; ++i) {
    Float16 sum{};
    for (std::uint32_t e = first[i]; e < first[i + 1]; e += 2)
      sum += *reinterpret_cast<const Float16*>(sums + std::size_t(edges[e + 1]) * 16) -
             *reinterpret_cast<const Float16*>(sums + std::size_t(edges[e]) * 16);
    const float *n = normals + std::size_t(i) * 3, x = n[0], y = n[1], z = n[2];
    for (int c = 0; c < 3; ++c)
      blocked[std::size_t(i) * 3 + std::size_t(c)] = x * sum[c] + y * sum[4 + c] + z * sum[8 + c];
  }
}

}  // namespace

void CellLight::update_pieces(const glm::mat3& object_from_marker, int level_size) {
  const OctahedralGrid& grid = octahedral_grid(size_);
  // Texels wider than the finest cells are cut, as squares of their face.
  const int n = std::max(1, kLevelSize / level_size) * level_size;
  const std::vector<double> angles = texel_solid_angles(n);
  pieces_.clear();
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const glm::vec3 d = object_from_marker * glm::normalize(texel_direction(f, x, y, n));
        const OctahedralGrid::Corners corners = grid.around(d);
        const float angle = float(angles[std::size_t(y) * std::size_t(n) + std::size_t(x)]);
        Piece piece{angle * d, angle, {}, {}};
        for (int k = 0; k < 4; ++k)
          piece.cells[k] = std::uint16_t(corners.cells[k]), piece.shares[k] = corners.shares[k];
        pieces_.push_back(piece);
      }
  level_size_ = level_size, object_from_marker_ = object_from_marker;
}

void CellLight::update(const CubeMap& radiance, const glm::mat3& object_from_marker, int size) {
  check(radiance.size() > 0, "self-shadow needs a map");
  const CubeLevel& level = radiance.level_at_most(kLevelSize);
  const int n = level.size(), parts = std::max(1, kLevelSize / n);
  const std::span<const std::uint64_t> versions = radiance.tile_versions();
  const bool same_cells =
      size == size_ && n == level_size_ && object_from_marker == object_from_marker_;
  if (same_cells &&
      std::equal(versions.begin(), versions.end(), versions_.begin(), versions_.end()))
    return;
  versions_.assign(versions.begin(), versions.end());
  if (!same_cells) {
    size_ = size;
    update_pieces(object_from_marker, n);
  }
  struct Cell {
    Float4 moments[3]{};
    float flux = 0;
  };
  std::vector<Cell> cells(std::size_t(size) * std::size_t(size));
  const Piece* piece = pieces_.data();
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n * parts; ++y)
      for (int x = 0; x < n * parts; ++x, ++piece) {
        const glm::vec3& texel = level.texel(f, x / parts, y / parts);
        const Float4 colour = {texel.x, texel.y, texel.z, 0};
        const float flux = (texel.x + texel.y + texel.z) * piece->solid_angle;
        const glm::vec3 m = piece->moment;
        const Float4 moments[3] = {colour * m.x, colour * m.y, colour * m.z};
        for (int k = 0; k < 4; ++k) {
          Cell& cell = cells[piece->cells[k]];
          for (int c = 0; c < 3; ++c) cell.moments[c] += piece->shares[k] * moments[c];
          cell.flux += piece->shares[k] * flux;
        }
      }
  // In double: a difference of two sums is exact within the rounding of the sums themselves, not of
  // all that were added before.
  sums_.assign(cells.size() + 1, {});
  double total[12]{};
  for (std::size_t k = 0; k < cells.size(); ++k)
    for (std::size_t c = 0; c < 12; ++c) {
      total[c] += double(cells[k].moments[c / 4][c % 4]);
      sums_[k + 1].values[c] = float(total[c]);
    }
  double whole = 0;
  for (const Cell& cell : cells) whole += double(cell.flux);
  const double scale = whole > 0 ? 1 / whole : 0;
  flux_.resize(cells.size());
  for (std::size_t k = 0; k < cells.size(); ++k) flux_[k] = float(double(cells[k].flux) * scale);
}

void blocked_irradiance(const VertexVisibility& visibility, const CellLight& light,
                        std::span<const glm::vec3> normals, std::span<glm::vec3> blocked) {
  check(visibility.size == light.size(), "light must have the cells of the visibility, ",
        visibility.size, ", got ", light.size());
  check(visibility.vertex_count() == normals.size() && normals.size() == blocked.size(),
        "there must be as many normals and results as vertices, ", visibility.vertex_count(),
        ", got ", normals.size(), " and ", blocked.size());
  parallel_for(int(normals.size()), kGrain, [&](int begin, int end) {
    add_runs(visibility.first.data() + begin, visibility.edges.data(), light.before(0).values,
             &normals[std::size_t(begin)].x, end - begin, &blocked[std::size_t(begin)].x);
  });
}

void diffuse_shares(const VertexVisibility& visibility, const CellLight& light,
                    const Irradiance& irradiance, std::span<const glm::vec3> normals,
                    const glm::mat3& marker_from_object, std::span<glm::vec4> shares) {
  check(shares.size() == normals.size(), "there must be as many shares as vertices, ",
        normals.size(), ", got ", shares.size());
  std::vector<glm::vec3> blocked(normals.size()), turned(normals.size()), all(normals.size());
  blocked_irradiance(visibility, light, normals, blocked);
  for (std::size_t i = 0; i < normals.size(); ++i) turned[i] = marker_from_object * normals[i];
  evaluate(irradiance, turned, all);
  for (std::size_t i = 0; i < normals.size(); ++i)
    for (int c = 0; c < 3; ++c)
      shares[i][c] = all[i][c] > 0 ? std::clamp(1 - blocked[i][c] / all[i][c], 0.0f, 1.0f) : 1.0f;
}

void add_shares(std::span<const glm::vec3> changes, std::span<glm::vec4> shares) {
  check(changes.size() == shares.size(), "there must be as many changes as shares, ", shares.size(),
        ", got ", changes.size());
  for (std::size_t i = 0; i < shares.size(); ++i)
    for (int c = 0; c < 3; ++c) shares[i][c] = std::max(shares[i][c] + changes[i][c], 0.0f);
}

}  // namespace fastibl
