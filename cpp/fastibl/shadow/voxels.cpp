#include "fastibl/shadow/voxels.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr int kBorder = 4;  // empty voxels on each side, so that spheres may stick out a little

// The 13 directions to the 26 neighbours.
constexpr LineSet kLines[] = {{0, 0, 0},  {1, 0, -1}, {1, 0, 0},  {1, 0, 1}, {2, -1, -1},
                              {2, -1, 0}, {2, -1, 1}, {2, 0, -1}, {2, 0, 0}, {2, 0, 1},
                              {2, 1, -1}, {2, 1, 0},  {2, 1, 1}};

// Numbers of crossings before each voxel on its line (below) and on the whole line (total).
struct Crossings {
  std::vector<std::uint16_t> below, total;
};

Crossings count_crossings(const Mesh& mesh, const VoxelGrid& grid, const LineSet& lines) {
  const int c = lines.axis, a = (c + 1) % 3, b = (c + 2) % 3;
  const auto voxel = [&](int ia, int ib, int ic) {
    return ia * grid.stride(a) + ib * grid.stride(b) + ic * grid.stride(c);
  };
  const auto inside_grid = [&](int ia, int ib) {
    return ia >= 0 && ib >= 0 && ia < grid.size[a] && ib < grid.size[b];
  };
  Crossings k;
  k.below.assign(std::size_t(grid.count()), 0);
  for_line_crossings(mesh, grid, lines, [&](int u, int v, double w) {
    const int ic = std::clamp(int(std::floor(w)) + 1, 0, grid.size[c] - 1);  // first voxel after
    const int ia = u + lines.sa * ic, ib = v + lines.sb * ic;
    if (inside_grid(ia, ib)) ++k.below[std::size_t(voxel(ia, ib, ic))];
  });
  const int step = voxel(lines.sa, lines.sb, 1);
  for (int ic = 1; ic < grid.size[c]; ++ic)
    for (int ib = 0; ib < grid.size[b]; ++ib)
      for (int ia = 0; ia < grid.size[a]; ++ia)
        if (inside_grid(ia - lines.sa, ib - lines.sb)) {
          const int i = voxel(ia, ib, ic);
          k.below[std::size_t(i)] =
              std::uint16_t(k.below[std::size_t(i)] + k.below[std::size_t(i - step)]);
        }
  k.total = k.below;
  for (int ic = grid.size[c] - 2; ic >= 0; --ic)
    for (int ib = 0; ib < grid.size[b]; ++ib)
      for (int ia = 0; ia < grid.size[a]; ++ia)
        if (inside_grid(ia + lines.sa, ib + lines.sb)) {
          const int i = voxel(ia, ib, ic);
          k.total[std::size_t(i)] = k.total[std::size_t(i + step)];
        }
  return k;
}

// A torn mesh leaves single voxels voted out, and one is enough to hold back the balls around it.
// An outside voxel with at least 18 of its 26 neighbours inside becomes inside; beside a flat face
// there are 9 and in a concave edge 15, so whole meshes change in concave corners only.
std::vector<std::uint8_t> fill_pores(const std::vector<std::uint8_t>& inside,
                                     const VoxelGrid& grid) {
  std::vector<std::uint8_t> filled = inside;
  parallel_for(grid.size.z - 2, 4, [&](int begin, int end) {
    for (int z = begin + 1; z <= end; ++z)
      for (int y = 1; y + 1 < grid.size.y; ++y)
        for (int x = 1; x + 1 < grid.size.x; ++x) {
          const int i = grid.index(x, y, z);
          if (inside[std::size_t(i)]) continue;
          int count = 0;
          for (int dz = -1; dz <= 1; ++dz)
            for (int dy = -1; dy <= 1; ++dy)
              for (int dx = -1; dx <= 1; ++dx)
                count += inside[std::size_t(i + grid.index(dx, dy, dz))];
          filled[std::size_t(i)] = count >= 18;
        }
  });
  return filled;
}

// Lower envelope of parabolas: out[i] = min over j of in[j] + (i − j)².
void distance_line(const float* in, float* out, int n, std::vector<int>& at,
                   std::vector<float>& from) {
  int k = 0;
  at[0] = 0, from[0] = -1e30f;
  for (int i = 1; i < n; ++i) {
    const auto meet = [&] {
      const int j = at[std::size_t(k)];
      return ((in[i] + float(i * i)) - (in[j] + float(j * j))) / float(2 * (i - j));
    };
    float s = meet();
    while (k > 0 && s <= from[std::size_t(k)]) --k, s = meet();
    if (s <= from[std::size_t(k)]) k = -1;
    ++k;
    at[std::size_t(k)] = i, from[std::size_t(k)] = k == 0 ? -1e30f : s;
  }
  for (int i = 0, j = 0; i < n; ++i) {
    while (j < k && from[std::size_t(j + 1)] < float(i)) ++j;
    const int d = i - at[std::size_t(j)];
    out[i] = in[at[std::size_t(j)]] + float(d * d);
  }
}

}  // namespace

VoxelGrid make_voxel_grid(const Bounds& box, int resolution, const glm::dvec3& shift) {
  const glm::dvec3 lower(box.lower), extent = glm::dvec3(box.upper) - lower;
  VoxelGrid grid;
  grid.cell = std::max({extent.x, extent.y, extent.z}) / resolution;
  for (int i = 0; i < 3; ++i)
    grid.size[i] = std::max(1, int(std::ceil(extent[i] / grid.cell - 1e-6))) + 2 * kBorder;
  // Off the middle by a little, another amount on each axis: voxel centres then do not lie exactly
  // in faces of boxes and other meshes with neat coordinates.
  const glm::dvec3 off = glm::dvec3(0.0137, -0.0171, 0.0093) + shift;
  grid.origin = lower + 0.5 * extent - grid.cell * (0.5 * glm::dvec3(grid.size - 1) + off);
  return grid;
}

std::vector<std::uint8_t> inside_voxels(const Mesh& mesh, const VoxelGrid& grid) {
  const int rays = 2 * int(std::size(kLines));
  std::vector<std::uint8_t> odd(std::size_t(grid.count())), met(odd.size());
  for (const LineSet& lines : kLines) {
    const Crossings crossings = count_crossings(mesh, grid, lines);
    parallel_for(grid.count(), 65536, [&](int begin, int end) {
      for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
        const int below = crossings.below[i], above = crossings.total[i] - below;
        odd[i] = std::uint8_t(odd[i] + (below & 1) + (above & 1));
        met[i] = std::uint8_t(met[i] + (below > 0) + (above > 0));
      }
    });
  }
  for (std::size_t i = 0; i < odd.size(); ++i) odd[i] = 2 * odd[i] > rays || met[i] == rays;
  for (int round = 0; round < 2; ++round) odd = fill_pores(odd, grid);
  return odd;
}

// Felzenszwalb and Huttenlocher 2012, Distance Transforms of Sampled Functions: one axis after the
// other.
std::vector<float> squared_distances(const std::vector<std::uint8_t>& inside,
                                     const VoxelGrid& grid) {
  std::vector<float> d(inside.size());
  // 1e6 instead of infinity: differences stay finite, and grids are narrower than 1000 voxels.
  for (std::size_t i = 0; i < d.size(); ++i) d[i] = inside[i] ? 1e6f : 0.0f;
  for (int axis = 0; axis < 3; ++axis) {
    const int n = grid.size[axis], stride = grid.stride(axis);
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    parallel_for(grid.size[a] * grid.size[b], 64, [&](int begin, int end) {
      const std::size_t length = std::size_t(n);
      std::vector<float> in(length), out(length), from(length);
      std::vector<int> at(length);
      for (int line = begin; line < end; ++line) {
        float* first = &d[std::size_t(line % grid.size[a] * grid.stride(a) +
                                      line / grid.size[a] * grid.stride(b))];
        for (int i = 0; i < n; ++i) in[std::size_t(i)] = first[i * stride];
        distance_line(in.data(), out.data(), n, at, from);
        for (int i = 0; i < n; ++i) first[i * stride] = out[std::size_t(i)];
      }
    });
  }
  return d;
}

}  // namespace fastibl
