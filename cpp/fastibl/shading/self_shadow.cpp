#include "fastibl/shading/self_shadow.h"

#include <algorithm>
#include <atomic>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/octahedral.h"

namespace fastibl {
namespace {

constexpr int kGrain = 512;  // vertices

std::atomic<std::uint64_t> last_version = 0;

bool is_fine(int cells) { return cells >= 64; }
// Size of the map's level: texels as wide as the cells, or half as wide.
int finest_level(int cells) { return is_fine(cells) ? 64 : 32; }

// Adds up the runs of each vertex, and turns them into the light that falls on it. This goes in
// parts: AVX2 does not keep sums of sixteen in registers.
FASTIBL_CLONES void add_runs(const std::uint32_t* first, const std::uint16_t* edges,
                             const float* sums, const float* normals, int count, float* blocked) {
  for (int i = 0; i < count; ++i) {
    Float8 of_xy{};
    Float4 of_z{};
    for (std::uint32_t e = first[i]; e < first[i + 1]; e += 2) {
      const float *begin = sums + std::size_t(edges[e]) * 16,
                  *end = sums + std::size_t(edges[e + 1]) * 16;
      of_xy += *reinterpret_cast<const Float8*>(end) - *reinterpret_cast<const Float8*>(begin);
      of_z +=
          *reinterpret_cast<const Float4*>(end + 8) - *reinterpret_cast<const Float4*>(begin + 8);
    }
    const float *n = normals + std::size_t(i) * 3, x = n[0], y = n[1], z = n[2];
    for (int c = 0; c < 3; ++c)
      blocked[std::size_t(i) * 3 + std::size_t(c)] = x * of_xy[c] + y * of_xy[4 + c] + z * of_z[c];
  }
}

}  // namespace

// Cells as fine as a map's texels take the pieces that lie in them. Coarse cells, which an object
// blocks whole or not at all, share each piece with their neighbours.
void CellLight::update_pieces(const glm::mat3& object_from_marker, int level_size) {
  const OctahedralGrid& grid = octahedral_grid(size_);
  parts_ = std::max(1, finest_level(size_) / level_size);
  cells_of_square_ = is_fine(size_) ? 1 : 4;
  const int n = parts_ * level_size;
  const std::vector<double> angles = texel_solid_angles(n);
  pieces_.clear();
  const auto add = [&](int face, int x, int y) {
    const glm::vec3 d = object_from_marker * glm::normalize(texel_direction(face, x, y, n));
    const float angle = float(angles[std::size_t(y) * std::size_t(n) + std::size_t(x)]);
    if (is_fine(size_)) {
      const glm::vec2 p = float(size_) * octahedral_point(d);
      const int cell = grid.cell(std::min(int(p.x), size_ - 1), std::min(int(p.y), size_ - 1));
      pieces_.push_back({angle * d, angle, cell});
      return;
    }
    const OctahedralGrid::Corners corners = grid.around(d);
    for (int k = 0; k < 4; ++k)
      pieces_.push_back(
          {corners.shares[k] * angle * d, corners.shares[k] * angle, corners.cells[k]});
  };
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < level_size; ++y)
      for (int x = 0; x < level_size; ++x)  // a wider texel is cut, as squares of its face
        for (int k = 0; k < parts_ * parts_; ++k)
          add(f, x * parts_ + k % parts_, y * parts_ + k / parts_);
  level_size_ = level_size, object_from_marker_ = object_from_marker;
}

void CellLight::update(const CubeMap& radiance, const glm::mat3& object_from_marker, int size) {
  check(radiance.size() > 0, "self-shadow needs a map");
  const CubeLevel& level = radiance.level_at_most(finest_level(size));
  const int n = level.size();
  const std::span<const std::uint64_t> versions = radiance.tile_versions();
  const bool same_cells =
      size == size_ && n == level_size_ && object_from_marker == object_from_marker_;
  if (same_cells &&
      std::equal(versions.begin(), versions.end(), versions_.begin(), versions_.end()))
    return;
  versions_.assign(versions.begin(), versions.end());
  version_ = ++last_version;
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
  const std::size_t per_texel = pieces_.size() / (6 * std::size_t(n) * std::size_t(n));
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const glm::vec3& texel = level.texel(f, x, y);
        const Float4 colour = {texel.x, texel.y, texel.z, 0};
        const float sum = texel.x + texel.y + texel.z;
        for (const Piece* end = piece + per_texel; piece < end; ++piece) {
          Cell& cell = cells[std::size_t(piece->cell)];
          for (int c = 0; c < 3; ++c) cell.moments[c] += colour * piece->moment[c];
          cell.flux += sum * piece->solid_angle;
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
  check(visibility.vertex_count() == normals.size() && visibility.entries() == blocked.size(),
        "there must be as many normals as vertices and results as entries, ",
        visibility.vertex_count(), " and ", visibility.entries(), ", got ", normals.size(), " and ",
        blocked.size());
  const int count = int(normals.size());
  for (int side = 0; side < visibility.sides; ++side)
    parallel_for(count, kGrain, [&](int begin, int end) {
      const std::size_t at = std::size_t(side * count + begin);
      add_runs(visibility.first.data() + at, visibility.edges.data(), light.before(0).values,
               &normals[std::size_t(begin)].x, end - begin, &blocked[at].x);
    });
  for (std::size_t i = normals.size(); i < blocked.size(); ++i) blocked[i] = -blocked[i];
}

void diffuse_shares(const VertexVisibility& visibility, const CellLight& light,
                    const Irradiance& irradiance, std::span<const glm::vec3> normals,
                    const glm::mat3& marker_from_object, std::span<glm::vec4> shares) {
  check(shares.size() == visibility.entries(), "there must be as many shares as entries, ",
        visibility.entries(), ", got ", shares.size());
  const std::size_t count = shares.size();
  std::vector<glm::vec3> blocked(count), turned(count), all(count);
  blocked_irradiance(visibility, light, normals, blocked);
  for (std::size_t i = 0; i < count; ++i)
    turned[i] = i < normals.size() ? marker_from_object * normals[i] : -turned[i - normals.size()];
  evaluate(irradiance, turned, all);
  for (std::size_t i = 0; i < count; ++i)
    for (int c = 0; c < 3; ++c)
      shares[i][c] = all[i][c] > 0 ? std::clamp(1 - blocked[i][c] / all[i][c], 0.0f, 1.0f) : 1.0f;
}

void add_shares(std::span<const glm::vec3> changes, std::span<glm::vec4> shares) {
  check(changes.size() == shares.size() || 2 * changes.size() == shares.size(),
        "there must be as many changes as vertices, got ", changes.size(), " for ", shares.size(),
        " shares");
  for (std::size_t i = 0; i < changes.size(); ++i)
    for (int c = 0; c < 3; ++c) shares[i][c] = std::max(shares[i][c] + changes[i][c], 0.0f);
}

}  // namespace fastibl
