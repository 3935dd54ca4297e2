#include "fastibl/shadow/fit_spheres.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/stray_vertices.h"
#include "fastibl/shadow/outlines.h"
#include "fastibl/shadow/refine_spheres.h"
#include "fastibl/shadow/voxel_surface.h"
#include "fastibl/shadow/voxels.h"

namespace fastibl {
namespace {

// A ball of the cover, in voxels.
struct Ball {
  int x, y, z;
  float radius;
  float gain;
};

// Radii tried around each centre, beside its distance to the nearest outside voxel (which lies half
// a voxel beyond the surface): balls that stick out cover what inscribed ones leave between them.
constexpr float kRadii[] = {-0.5f, 0.0f, 0.5f, 1.0f, 1.75f, 2.5f};
// Worth of an outside voxel. A size slightly below an inside one's, 1, fitted better on four
// meshes.
constexpr float kOutside = -0.85f;
// Spacing of centres, over their distance to the outside. Closer ones are no better, but slow.
constexpr float kSpacing = 1 / 8.0f;

// Calls visit(y, z, first x, last x) for the rows of a ball.
template <typename Visit>
void for_rows(const VoxelGrid& grid, const Ball& ball, Visit&& visit) {
  const int reach = int(ball.radius);
  for (int z = std::max(ball.z - reach, 0); z <= std::min(ball.z + reach, grid.size.z - 1); ++z)
    for (int y = std::max(ball.y - reach, 0); y <= std::min(ball.y + reach, grid.size.y - 1); ++y) {
      const int dz = z - ball.z, dy = y - ball.y;
      const float left = ball.radius * ball.radius - float(dz * dz + dy * dy);
      if (left < 0) continue;
      const int half = int(std::sqrt(left));
      visit(y, z, std::max(ball.x - half, 0), std::min(ball.x + half, grid.size.x - 1));
    }
}

// Centres on the ridges of the distance field (no neighbour's ball contains theirs), in all radii.
std::vector<Ball> ridge_balls(const std::vector<float>& squared, const VoxelGrid& grid) {
  const auto is_ridge = [&](int i, float distance) {
    for (int dz = -1; dz <= 1; ++dz)
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          if (dx == 0 && dy == 0 && dz == 0) continue;
          const float step = std::sqrt(float(dx * dx + dy * dy + dz * dz));
          const float there = std::sqrt(squared[std::size_t(i + grid.index(dx, dy, dz))]);
          // A quarter voxel of slack: distances of a voxel grid rise by slightly less than the
          // step.
          if (there >= distance + step - 0.25f) return false;
        }
    return true;
  };
  // One ridge voxel stands for all close to it, measured by their distance: flat bodies have ridges
  // that are whole sheets. Cells of 2^k voxels keep the voxel of the largest distance.
  std::map<std::array<int, 4>, std::array<int, 3>> best;
  for (int z = 1; z + 1 < grid.size.z; ++z)
    for (int y = 1; y + 1 < grid.size.y; ++y)
      for (int x = 1; x + 1 < grid.size.x; ++x) {
        const int i = grid.index(x, y, z);
        const float d2 = squared[std::size_t(i)];
        if (d2 == 0 || !is_ridge(i, std::sqrt(d2))) continue;
        const int k = std::max(0, int(std::log2(std::sqrt(d2) * kSpacing)));
        const auto [at, added] = best.try_emplace({k, z >> k, y >> k, x >> k}, std::array{x, y, z});
        const auto& [bx, by, bz] = at->second;
        if (!added && d2 > squared[std::size_t(grid.index(bx, by, bz))]) at->second = {x, y, z};
      }
  std::vector<Ball> balls;
  for (const auto& [cell, at] : best) {
    const auto& [x, y, z] = at;
    const float distance = std::sqrt(squared[std::size_t(grid.index(x, y, z))]);
    for (const float more : kRadii) balls.push_back({x, y, z, distance + more, 0});
  }
  return balls;
}

// Gain of a ball: the worth of its voxels that no chosen ball covers. A voxel is worth 1 inside and
// kOutside outside, divided by the local thickness (radius of the largest ball there): otherwise
// thin parts, small in volume but not in the shadow, are left out. Rows are kept as prefix sums, so
// that a ball costs its rows instead of its voxels.
class Cover {
 public:
  Cover(const std::vector<std::uint8_t>& inside, const std::vector<Ball>& balls,
        const VoxelGrid& grid)
      : grid_(grid),
        worth_(inside.size()),
        sums_(std::size_t(grid.size.x + 1) * std::size_t(grid.size.y * grid.size.z)) {
    std::vector<Ball> ascending = balls;  // so that the largest is written last
    std::stable_sort(ascending.begin(), ascending.end(),
                     [](const Ball& a, const Ball& b) { return a.radius < b.radius; });
    for (const Ball& ball : ascending)
      for_rows(grid, ball, [&](int y, int z, int first, int last) {
        std::fill_n(&worth_[std::size_t(grid.index(first, y, z))], last - first + 1, ball.radius);
      });
    for (std::size_t i = 0; i < worth_.size(); ++i)
      if (worth_[i] > 0) worth_[i] = (inside[i] ? 1.0f : kOutside) / std::max(worth_[i], 1.0f);
    for (int z = 0; z < grid.size.z; ++z)
      for (int y = 0; y < grid.size.y; ++y) sum_row(y, z);
  }

  float gain(const Ball& ball) const {
    float sum = 0;
    for_rows(grid_, ball, [&](int y, int z, int first, int last) {
      const float* s = &sums_[sums_index(y, z)];
      sum += s[last + 1] - s[first];
    });
    return sum;
  }

  void choose(const Ball& ball) {  // its voxels are worth nothing from now on
    for_rows(grid_, ball, [&](int y, int z, int first, int last) {
      std::fill_n(&worth_[std::size_t(grid_.index(first, y, z))], last - first + 1, 0.0f);
      sum_row(y, z);
    });
  }

 private:
  std::size_t sums_index(int y, int z) const {
    return std::size_t(z * grid_.size.y + y) * std::size_t(grid_.size.x + 1);
  }
  void sum_row(int y, int z) {
    float* s = &sums_[sums_index(y, z)];
    const std::size_t first = std::size_t(grid_.index(0, y, z));
    s[0] = 0;
    for (std::size_t x = 0; x < std::size_t(grid_.size.x); ++x) s[x + 1] = s[x] + worth_[first + x];
  }

  const VoxelGrid& grid_;
  std::vector<float> worth_;
  std::vector<float> sums_;
};

void weigh(std::vector<Ball>& balls, const Cover& state) {
  parallel_for(int(balls.size()), 64, [&](int begin, int end) {
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i)
      balls[i].gain = state.gain(balls[i]);
  });
}

bool smaller_gain(const Ball& a, const Ball& b) { return a.gain < b.gain; }

// Greedy: takes the ball of the largest gain each time. Gains seldom rise when a ball is chosen, so
// an old gain serves as bound (lazy greedy, Minoux 1978). In voxels.
SphereSet cover(const std::vector<std::uint8_t>& inside, std::vector<Ball> balls,
                const VoxelGrid& grid, int count) {
  Cover state(inside, balls, grid);
  weigh(balls, state);
  std::vector<Ball> heap = balls, chosen;
  std::make_heap(heap.begin(), heap.end(), smaller_gain);
  while (int(chosen.size()) < count && !heap.empty()) {
    std::pop_heap(heap.begin(), heap.end(), smaller_gain);
    Ball& ball = heap.back();
    ball.gain = state.gain(ball);
    const bool best = heap.size() == 1 || ball.gain >= heap.front().gain;
    if (best && ball.gain > 0) {
      chosen.push_back(ball);
      state.choose(ball);
    }
    if (best || !(ball.gain > 0))
      heap.pop_back();
    else
      std::push_heap(heap.begin(), heap.end(), smaller_gain);
  }
  SphereSet spheres;
  for (const Ball& ball : chosen)
    spheres.emplace_back(float(ball.x), float(ball.y), float(ball.z), ball.radius);
  return spheres;
}

// The balls that are inscribed, smaller by the voxel in which the surface may run.
SphereSet filling_of(const std::vector<Ball>& balls) {
  SphereSet filling;
  for (std::size_t i = 0; i < balls.size(); i += std::size(kRadii)) {
    const Ball& ball = balls[i];
    const float radius = ball.radius - kRadii[0] - 1;
    if (radius > 0) filling.emplace_back(float(ball.x), float(ball.y), float(ball.z), radius);
  }
  return filling;
}

// Points spread over the surface with the area that each stands for.
std::vector<glm::vec4> surface_samples(const Mesh& mesh, float spacing) {
  const int finest = std::max(1, int(std::sqrt(2e5 / double(mesh.triangles.size()))));
  std::vector<glm::vec4> samples;
  for (const glm::ivec3& t : mesh.triangles) {
    const glm::vec3 a = mesh.vertices[std::size_t(t[0])], u = mesh.vertices[std::size_t(t[1])] - a,
                    v = mesh.vertices[std::size_t(t[2])] - a;
    const float longest = std::max({glm::length(u), glm::length(v), glm::length(u - v)});
    // longest may be 0 with spacing: the quotient is NaN, fmax drops it.
    const int k = int(std::fmax(1.0f, std::fmin(std::ceil(longest / spacing), float(finest))));
    const float area = 0.5f * glm::length(glm::cross(u, v)) / float(k * k), third = 1.0f / 3;
    for (int j = 0; j < k; ++j)
      for (int i = 0; i + j < k; ++i) {
        const glm::vec3 corner = a + (float(i) * u + float(j) * v) / float(k);
        samples.emplace_back(corner + third * (u + v) / float(k), area);
        if (i + j + 1 < k) samples.emplace_back(corner + 2 * third * (u + v) / float(k), area);
      }
  }
  return samples;
}

// For meshes that enclose nothing: centres far apart (farthest point first), moved to the middle of
// the samples nearest to each; all of one radius, so that their discs have the mesh's area.
SphereSet surface_spheres(const Mesh& mesh, int count, int resolution, float longest_edge) {
  const float spacing = longest_edge / float(resolution);
  const std::vector<glm::vec4> samples = surface_samples(mesh, spacing);
  std::vector<float> distance(samples.size(), std::numeric_limits<float>::infinity());
  std::vector<std::size_t> nearest(samples.size());
  SphereSet spheres;
  for (std::size_t next = 0; int(spheres.size()) < count;) {
    spheres.push_back(samples[next]);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const glm::vec3 d = glm::vec3(samples[i]) - glm::vec3(samples[next]);
      if (glm::dot(d, d) < distance[i])
        distance[i] = glm::dot(d, d), nearest[i] = spheres.size() - 1;
    }
    next = std::size_t(std::max_element(distance.begin(), distance.end()) - distance.begin());
    if (!(distance[next] > spacing * spacing)) break;
  }
  std::vector<glm::dvec4> sums(spheres.size(), glm::dvec4(0));
  double area = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const double w = samples[i].w;
    sums[nearest[i]] += glm::dvec4(w * glm::dvec3(samples[i]), w);
    area += w;
  }
  const double radius = std::max({std::sqrt(area / (std::numbers::pi * double(spheres.size()))),
                                  0.5 * spacing, 1e-6});  // the last for a mesh that is one point
  for (std::size_t k = 0; k < spheres.size(); ++k)
    spheres[k] = {
        sums[k].w > 0 ? glm::vec3(glm::dvec3(sums[k]) / sums[k].w) : glm::vec3(spheres[k]),
        float(radius)};
  return spheres;
}

// A third of a voxel at most on each axis, none for seed 0: steps of the golden ratio of three
// numbers (Roberts 2018, The Unreasonable Effectiveness of Quasirandom Sequences).
glm::dvec3 shift_of(unsigned seed) {
  const glm::dvec3 at = double(seed) * glm::dvec3(0.8191725134, 0.6710436067, 0.5497004779);
  return (at - glm::round(at)) * (2 / 3.0);
}

}  // namespace

SphereSet fit_spheres(const Mesh& given, const FitSpheresOptions& options) {
  const Mesh mesh = without_strays(given);
  check(options.count >= 1, "the number of spheres must be at least 1, got ", options.count);
  check(options.resolution >= 8 && options.resolution <= 128,
        "the voxel resolution must be 8 to 128, got ", options.resolution);
  const Bounds box = bounds(mesh.vertices);
  const glm::vec3 extent = box.upper - box.lower;
  const float longest = std::max({extent.x, extent.y, extent.z});
  check(std::isfinite(longest) && longest < 1e15f, "the mesh must be narrower than 1e15 m, got ",
        longest);
  SphereSet spheres;
  if (longest > 0) {
    const VoxelGrid grid = make_voxel_grid(box, options.resolution, shift_of(options.seed));
    const std::vector<std::uint8_t> inside = inside_voxels(mesh, grid);
    if (std::find(inside.begin(), inside.end(), 1) != inside.end()) {
      const std::vector<Ball> balls = ridge_balls(squared_distances(inside, grid), grid);
      spheres = refine_spheres(cover(inside, balls, grid, options.count),
                               surface_points(mesh, grid, inside), inside, grid,
                               outlines_of(mesh, filling_of(balls), grid));
      for (glm::vec4& s : spheres)
        s = glm::vec4(glm::vec3(grid.origin + grid.cell * glm::dvec3(glm::vec3(s))),
                      float(grid.cell * double(s.w)));
    }
  }
  if (spheres.empty()) spheres = surface_spheres(mesh, options.count, options.resolution, longest);
  return spheres;
}

}  // namespace fastibl
