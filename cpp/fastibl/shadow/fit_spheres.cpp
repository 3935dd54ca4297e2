#include "fastibl/shadow/fit_spheres.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <queue>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr int kBorder = 4;  // empty voxels around the mesh, so that spheres may stick out a little

// Voxels around a mesh; the centre of voxel (x, y, z) is at origin + cell · (x, y, z).
struct Grid {
  glm::ivec3 size;
  glm::dvec3 origin;
  double cell;  // edge in metres

  int count() const { return size.x * size.y * size.z; }
  int stride(int axis) const { return axis == 0 ? 1 : axis == 1 ? size.x : size.x * size.y; }
  int index(int x, int y, int z) const { return (z * size.y + y) * size.x + x; }
};

Grid make_grid(const Bounds& box, int resolution) {
  const glm::dvec3 lower(box.lower), extent = glm::dvec3(box.upper) - lower;
  Grid grid;
  grid.cell = std::max({extent.x, extent.y, extent.z}) / resolution;
  for (int i = 0; i < 3; ++i)
    grid.size[i] = std::max(1, int(std::ceil(extent[i] / grid.cell - 1e-6))) + 2 * kBorder;
  // Off the middle by a little, another amount on each axis: voxel centres then do not lie exactly
  // in faces of boxes and other meshes with neat coordinates.
  const glm::dvec3 off(0.0137, -0.0171, 0.0093);
  grid.origin = lower + 0.5 * extent - grid.cell * (0.5 * glm::dvec3(grid.size - 1) + off);
  return grid;
}

// Lines through all voxel centres along an axis or a diagonal: (u, v) = (p[a] − sa p[c],
// p[b] − sb p[c]) is constant along one and a pair of whole numbers, with c the axis, a and b the
// two that follow. One line counts the crossings of all its voxels, so inside tests cost a
// rasterisation of the mesh instead of a ray a voxel.
struct LineSet {
  int axis, sa, sb;
};
// The 13 directions to the 26 neighbours.
constexpr LineSet kLines[] = {{0, 0, 0},  {1, 0, -1}, {1, 0, 0},  {1, 0, 1}, {2, -1, -1},
                              {2, -1, 0}, {2, -1, 1}, {2, 0, -1}, {2, 0, 0}, {2, 0, 1},
                              {2, 1, -1}, {2, 1, 0},  {2, 1, 1}};

// Calls visit(u, v, w) for the lines that meet the triangle; w is p[c] there. Half-open in v and u
// and computed alike from both sides of an edge, so a line never slips between two triangles or
// meets both at their common edge.
template <typename Visit>
void cross_lines(const glm::dvec3 (&q)[3], Visit&& visit) {
  const double lowest = std::min({q[0].y, q[1].y, q[2].y}),
               highest = std::max({q[0].y, q[1].y, q[2].y});
  for (int v = int(std::ceil(lowest)); v <= highest; ++v) {
    glm::dvec2 ends[2];  // (u, w) where two edges pass v
    int found = 0;
    for (int e = 0; e < 3 && found < 2; ++e) {
      const glm::dvec3 *a = &q[e], *b = &q[(e + 1) % 3];
      if ((a->y <= v) == (b->y <= v)) continue;
      if (a->y > b->y) std::swap(a, b);
      const double t = (v - a->y) / (b->y - a->y);
      ends[found++] = {a->x + t * (b->x - a->x), a->z + t * (b->z - a->z)};
    }
    if (found < 2) continue;
    if (ends[0].x > ends[1].x) std::swap(ends[0], ends[1]);
    const double slope = (ends[1].y - ends[0].y) / std::max(ends[1].x - ends[0].x, 1e-300);
    for (int u = int(std::floor(ends[0].x)) + 1; u <= ends[1].x; ++u)
      visit(u, v, ends[0].y + slope * (u - ends[0].x));
  }
}

// Numbers of crossings before each voxel on its line (below) and on the whole line (total).
struct Crossings {
  std::vector<std::uint16_t> below, total;
};

Crossings count_crossings(const Mesh& mesh, const Grid& grid, const LineSet& lines) {
  const int c = lines.axis, a = (c + 1) % 3, b = (c + 2) % 3;
  const auto voxel = [&](int ia, int ib, int ic) {
    return ia * grid.stride(a) + ib * grid.stride(b) + ic * grid.stride(c);
  };
  const auto inside_grid = [&](int ia, int ib) {
    return ia >= 0 && ib >= 0 && ia < grid.size[a] && ib < grid.size[b];
  };
  Crossings k;
  k.below.assign(std::size_t(grid.count()), 0);
  for (const glm::ivec3& triangle : mesh.triangles) {
    glm::dvec3 q[3];
    for (int i = 0; i < 3; ++i) {
      const glm::dvec3 p =
          (glm::dvec3(mesh.vertices[std::size_t(triangle[i])]) - grid.origin) / grid.cell;
      q[i] = {p[a] - lines.sa * p[c], p[b] - lines.sb * p[c], p[c]};
    }
    cross_lines(q, [&](int u, int v, double w) {
      const int ic = std::clamp(int(std::floor(w)) + 1, 0, grid.size[c] - 1);  // first voxel after
      const int ia = u + lines.sa * ic, ib = v + lines.sb * ic;
      if (inside_grid(ia, ib)) ++k.below[std::size_t(voxel(ia, ib, ic))];
    });
  }
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

// Inside = most of the 26 rays cross the mesh an odd number of times, or all of them meet it. The
// vote survives holes and flipped faces, the second lets open shells be full.
std::vector<std::uint8_t> inside_voxels(const Mesh& mesh, const Grid& grid) {
  const int sets = int(std::size(kLines));
  std::vector<Crossings> crossings(std::size(kLines));
  parallel_for(sets, 1, [&](int begin, int end) {
    for (int i = begin; i < end; ++i)
      crossings[std::size_t(i)] = count_crossings(mesh, grid, kLines[i]);
  });
  std::vector<std::uint8_t> inside(std::size_t(grid.count()));
  parallel_for(grid.count(), 4096, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      int odd = 0, met = 0;
      for (const Crossings& k : crossings) {
        const int below = k.below[std::size_t(i)], above = k.total[std::size_t(i)] - below;
        odd += (below & 1) + (above & 1);
        met += (below > 0) + (above > 0);
      }
      inside[std::size_t(i)] = odd > sets || met == 2 * sets;
    }
  });
  return inside;
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

// Squared distance in voxels to the nearest outside voxel, exact. Felzenszwalb and Huttenlocher
// 2012, Distance Transforms of Sampled Functions.
std::vector<float> squared_distances(const std::vector<std::uint8_t>& inside, const Grid& grid) {
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

struct Ball {
  int x, y, z;
  float radius;  // voxels
  float gain;
};

// What a ball is worth: voxels of the inside that no chosen ball covers count +1, voxels outside
// −1 (0 once covered). Rows are kept as prefix sums, so a ball costs its rows, not its voxels.
class Cover {
 public:
  Cover(const std::vector<std::uint8_t>& inside, const Grid& grid)
      : grid_(grid),
        worth_(inside.size()),
        balls_(inside.size()),
        sums_(inside.size() + std::size_t(grid.size.y) * grid.size.z) {
    for (std::size_t i = 0; i < worth_.size(); ++i) worth_[i] = inside[i] ? 1.0f : -1.0f;
    for (int z = 0; z < grid.size.z; ++z)
      for (int y = 0; y < grid.size.y; ++y) sum_row(y, z);
  }

  float gain(const Ball& ball) const {
    float sum = 0;
    rows(ball, [&](int y, int z, int first, int last) {
      const float* s = &sums_[std::size_t(z * grid_.size.y + y) * (std::size_t(grid_.size.x) + 1)];
      sum += s[last + 1] - s[first];
    });
    return sum;
  }

  // change: +1 to choose the ball, −1 to give it back.
  void change(const Ball& ball, int change) {
    rows(ball, [&](int y, int z, int first, int last) {
      for (int x = first; x <= last; ++x)
        balls_[std::size_t(grid_.index(x, y, z))] += std::int16_t(change);
      sum_row(y, z);
    });
  }

 private:
  template <typename Visit>
  void rows(const Ball& ball, Visit&& visit) const {
    const float r2 = ball.radius * ball.radius;
    const int reach = int(ball.radius);
    for (int z = std::max(ball.z - reach, 0); z <= std::min(ball.z + reach, grid_.size.z - 1); ++z)
      for (int y = std::max(ball.y - reach, 0); y <= std::min(ball.y + reach, grid_.size.y - 1);
           ++y) {
        const int dz = z - ball.z, dy = y - ball.y;
        const float left = r2 - float(dz * dz + dy * dy);
        if (left < 0) continue;
        const int half = int(std::sqrt(left));
        visit(y, z, std::max(ball.x - half, 0), std::min(ball.x + half, grid_.size.x - 1));
      }
  }

  void sum_row(int y, int z) {
    float* s = &sums_[std::size_t(z * grid_.size.y + y) * (std::size_t(grid_.size.x) + 1)];
    const std::size_t first = std::size_t(grid_.index(0, y, z));
    s[0] = 0;
    for (int x = 0; x < grid_.size.x; ++x)
      s[x + 1] = s[x] + (balls_[first + std::size_t(x)] == 0 ? worth_[first + std::size_t(x)] : 0);
  }

  const Grid& grid_;
  std::vector<float> worth_;
  std::vector<std::int16_t> balls_;  // number of chosen ones over each voxel
  std::vector<float> sums_;
};

#ifndef RADII
#define RADII -0.5f, 0.0f, 0.5f, 1.0f, 1.75f, 2.5f
#endif

// Balls at the ridges of the distance field, each in several sizes: those of no neighbour's ball
// contain it. A ball that sticks out a little covers the corners that inscribed ones leave.
std::vector<Ball> candidates(const std::vector<float>& squared, const Grid& grid) {
  std::vector<Ball> balls;
  for (int z = 1; z + 1 < grid.size.z; ++z)
    for (int y = 1; y + 1 < grid.size.y; ++y)
      for (int x = 1; x + 1 < grid.size.x; ++x) {
        const int i = grid.index(x, y, z);
        if (squared[std::size_t(i)] == 0) continue;
        const float d = std::sqrt(squared[std::size_t(i)]);
        bool ridge = true;
        for (int dz = -1; dz <= 1 && ridge; ++dz)
          for (int dy = -1; dy <= 1 && ridge; ++dy)
            for (int dx = -1; dx <= 1 && ridge; ++dx) {
              if (dx == 0 && dy == 0 && dz == 0) continue;
              const float step = std::sqrt(float(dx * dx + dy * dy + dz * dz));
              const float there = std::sqrt(squared[std::size_t(i + grid.index(dx, dy, dz))]);
              ridge = there < d + step - 0.25f;
            }
        if (!ridge) continue;
        for (const float more : {RADII}) balls.push_back({x, y, z, d + more, 0});
      }
  return balls;
}

SphereSet cover(const std::vector<std::uint8_t>& inside, const Grid& grid, int count) {
  std::vector<Ball> balls = candidates(squared_distances(inside, grid), grid);
  Cover state(inside, grid);
  const auto weigh = [&](auto&& stale) {
    parallel_for(int(balls.size()), 256, [&](int begin, int end) {
      for (int i = begin; i < end; ++i)
        if (stale(balls[std::size_t(i)]))
          balls[std::size_t(i)].gain = state.gain(balls[std::size_t(i)]);
    });
  };
  weigh([](const Ball&) { return true; });
  const auto change = [&](const Ball& ball, int by) {
    state.change(ball, by);
    weigh([&](const Ball& b) {  // those that overlap it
      const float dx = float(b.x - ball.x), dy = float(b.y - ball.y), dz = float(b.z - ball.z),
                  reach = b.radius + ball.radius;
      return dx * dx + dy * dy + dz * dz <= reach * reach;
    });
  };
  const auto best = [&] {
    return *std::max_element(balls.begin(), balls.end(),
                             [](const Ball& a, const Ball& b) { return a.gain < b.gain; });
  };
  std::vector<Ball> chosen;
  while (int(chosen.size()) < count) {
    const Ball ball = best();
    if (!(ball.gain > 0)) break;
    chosen.push_back(ball);
    change(ball, 1);
  }
  static const int kSweeps = getenv("SWEEPS") ? atoi(getenv("SWEEPS")) : 2;
  for (int sweep = 0; sweep < kSweeps; ++sweep)
    for (Ball& ball : chosen) {
      change(ball, -1);
      ball = best();
      change(ball, 1);
    }
  SphereSet spheres;
  for (const Ball& ball : chosen) {
    const glm::dvec3 centre = grid.origin + grid.cell * glm::dvec3(ball.x, ball.y, ball.z);
    spheres.emplace_back(glm::vec3(centre), float(grid.cell * ball.radius));
  }
  return spheres;
}

}  // namespace

SphereSet fit_spheres(const Mesh& mesh, const FitSpheresOptions& options) {
  mesh.validate();
  check(options.count >= 1, "the number of spheres must be at least 1, got ", options.count);
  check(options.resolution >= 8 && options.resolution <= 256,
        "the voxel resolution must be 8 to 256, got ", options.resolution);
  const Grid grid = make_grid(bounds(mesh.vertices), options.resolution);
  const std::vector<std::uint8_t> inside = inside_voxels(mesh, grid);
  return cover(inside, grid, options.count);
}

}  // namespace fastibl
