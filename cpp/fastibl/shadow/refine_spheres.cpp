#include "fastibl/shadow/refine_spheres.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <tuple>

#include "fastibl/core/lanes.h"
#include "fastibl/core/parallel.h"
#include "fastibl/shadow/outline_fit.h"
#include "fastibl/shadow/outline_weights.h"
#include "fastibl/shadow/sphere_step.h"
#include "fastibl/shadow/voxel_surface.h"

namespace fastibl {
namespace {

constexpr float kFar = 1e9f;
constexpr float kOutside = 4;  // weight of a point that is to be outside
constexpr float kMost = 3;     // distance in voxels beyond which a point is just uncovered

// Points side by side, filled up to whole lanes with points of no weight.
struct Samples {
  std::vector<float> x, y, z, nx, ny, nz, weight;
  std::vector<glm::vec4> bounds;  // sphere around each block
  int blocks = 0;
};

// Interleaves the bits of a point's cell, so that points near in the order are near in space.
std::uint32_t morton(glm::vec3 p) {
  std::uint32_t code = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto v = std::uint32_t(std::clamp(p[axis], 0.0f, 255.0f));
    for (std::uint32_t bit = 0; bit < 8; ++bit)
      code |= (v >> bit & 1) << (3 * bit + std::uint32_t(axis));
  }
  return code;
}

// The points of the surface in order, and then those that are to be outside.
Samples arrange(const std::vector<SurfacePoint>& points, const std::vector<float>& weights,
                std::vector<glm::vec3> outside) {
  std::sort(outside.begin(), outside.end(), [](const glm::vec3& a, const glm::vec3& b) {
    const std::uint32_t ma = morton(a), mb = morton(b);
    return ma != mb ? ma < mb : std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
  });
  Samples s;
  s.blocks = (int(points.size() + outside.size()) + kLanes - 1) / kLanes;
  for (std::vector<float>* v : {&s.x, &s.y, &s.z, &s.nx, &s.ny, &s.nz, &s.weight})
    v->assign(std::size_t(s.blocks * kLanes), 0.0f);
  const auto put = [&](std::size_t i, glm::vec3 p, glm::vec3 n, float weight) {
    s.x[i] = p.x, s.y[i] = p.y, s.z[i] = p.z;
    s.nx[i] = n.x, s.ny[i] = n.y, s.nz[i] = n.z;
    s.weight[i] = weight;
  };
  const std::size_t n = points.size(), all = n + outside.size();
  for (std::size_t i = 0; i < n; ++i) put(i, points[i].position, points[i].normal, weights[i]);
  // Without a normal, all spheres are in front.
  for (std::size_t i = n; i < all; ++i) put(i, outside[i - n], glm::vec3(0), kOutside);
  for (std::size_t i = all; i < s.x.size(); ++i)
    put(i, outside.empty() ? points.back().position : outside.back(), glm::vec3(0), 0);
  for (int b = 0; b < s.blocks; ++b) {
    glm::vec3 lower(kFar), upper(-kFar);
    for (std::size_t i = std::size_t(b * kLanes); i < std::size_t((b + 1) * kLanes); ++i) {
      const glm::vec3 p(s.x[i], s.y[i], s.z[i]);
      lower = glm::min(lower, p), upper = glm::max(upper, p);
    }
    s.bounds.emplace_back(0.5f * (lower + upper), 0.5f * glm::length(upper - lower));
  }
  return s;
}

// How the spheres lie to each point. Only a sphere with its centre behind the point's surface can
// have its own surface there; one with its centre in front must merely not contain the point.
struct Nearest {
  std::vector<std::int32_t> sphere, intruder;
  std::vector<float> distance;  // how far outside the nearest sphere from behind; negative: inside
  std::vector<float> second;    // how far outside the others
  std::vector<float> depth;     // how deep in the sphere from in front, negative; 0: in none
};

struct NearestPointers {
  std::int32_t *sphere, *intruder;
  float *distance, *second, *depth;
};

template <typename V>
FASTIBL_INLINE void find_nearest_by(const float* const* p, const float* bounds, int blocks,
                                    const float* spheres, int count, std::int32_t* near,
                                    const NearestPointers& out) {
  using Ints = IntsOf<V>;
  for (int b = 0; b < blocks; ++b) {
    // Spheres further from the block than kMost change nothing.
    int candidates = 0;
    for (int j = 0; j < count; ++j) {
      const float *s = spheres + 4 * j, *c = bounds + 4 * b;
      const float dx = c[0] - s[0], dy = c[1] - s[1], dz = c[2] - s[2], reach = c[3] + s[3] + kMost;
      near[candidates] = j;
      candidates += dx * dx + dy * dy + dz * dz < reach * reach;
    }
    for (int at = b * kLanes; at < (b + 1) * kLanes; at += kFloatsIn<V>) {
      V place[6];
      for (int k = 0; k < 6; ++k) place[k] = floats_at<V>(p[k] + at);
      V best = V{} + kMost, next = best, deepest{};
      Ints first{}, intruder{};
      for (int k = 0; k < candidates; ++k) {
        const int j = near[k];
        const float* s = spheres + 4 * j;
        const V dx = place[0] - s[0], dy = place[1] - s[1], dz = place[2] - s[2];
        const V squared = dx * dx + dy * dy + dz * dz;
        const V facing = dx * place[3] + dy * place[4] + dz * place[5];
        V d;
        for (int i = 0; i < kFloatsIn<V>; ++i) d[i] = __builtin_sqrtf(squared[i]);
        const Ints is_behind = facing > 0;
        d -= s[3];
        const V behind = is_behind ? d : V{} + kMost;
        const V in_front = is_behind ? V{} : d;
        const Ints nearer = behind < best, deeper = in_front < deepest;
        const V loser = nearer ? best : behind;
        next = loser < next ? loser : next;
        best = nearer ? behind : best;
        first = nearer ? Ints{} + j : first;
        deepest = deeper ? in_front : deepest;
        intruder = deeper ? Ints{} + j : intruder;
      }
      std::memcpy(out.sphere + at, &first, sizeof first);
      std::memcpy(out.intruder + at, &intruder, sizeof intruder);
      put_floats(best, out.distance + at), put_floats(next, out.second + at),
          put_floats(deepest, out.depth + at);
    }
  }
}
FASTIBL_BY_WIDTH(void find_nearest(const float* const* p, const float* bounds, int blocks,
                                   const float* spheres, int count, std::int32_t* near,
                                   const NearestPointers& out),
                 find_nearest_by<V>(p, bounds, blocks, spheres, count, near, out))

void find_nearest(const Samples& s, const SphereSet& spheres, Nearest& nearest) {
  const std::size_t n = s.x.size();
  nearest.sphere.resize(n), nearest.intruder.resize(n), nearest.distance.resize(n);
  nearest.second.resize(n), nearest.depth.resize(n);
  parallel_for(s.blocks, 64, [&](int begin, int end) {
    const std::size_t at = std::size_t(begin * kLanes);
    const float* const p[] = {&s.x[at], &s.y[at], &s.z[at], &s.nx[at], &s.ny[at], &s.nz[at]};
    std::vector<std::int32_t> near(spheres.size() + 1);
    find_nearest(p, &s.bounds[std::size_t(begin)].x, end - begin, &spheres[0].x,
                 int(spheres.size()), near.data(),
                 {&nearest.sphere[at], &nearest.intruder[at], &nearest.distance[at],
                  &nearest.second[at], &nearest.depth[at]});
  });
}

double cost(const Samples& s, const Nearest& nearest) {
  double sum = 0;
  for (std::size_t i = 0; i < s.x.size(); ++i)
    sum += double(s.weight[i]) * (std::abs(nearest.distance[i]) - nearest.depth[i]);
  return sum;
}

// One step of all spheres: each is fitted to the points nearest to it, by least squares whose
// weights, 1/|distance|, make them least absolute values. `softness`: distance below which they are
// squares after all.
void add_step(const Samples& s, const Nearest& nearest, const SphereSet& spheres, float softness,
              std::vector<SphereEquations>& all) {
  const auto add = [&](std::size_t i, std::int32_t sphere, float e) {
    const glm::vec4& c = spheres[std::size_t(sphere)];
    all[std::size_t(sphere)].add(glm::vec3(s.x[i], s.y[i], s.z[i]) - glm::vec3(c), c.w, e,
                                 s.weight[i] / std::sqrt(e * e + softness * softness));
  };
  for (std::size_t i = 0; i < s.x.size(); ++i) {
    if (nearest.distance[i] < kMost) add(i, nearest.sphere[i], nearest.distance[i]);
    if (nearest.depth[i] < 0) add(i, nearest.intruder[i], nearest.depth[i]);
  }
}

// Keeps the best of `iterations` steps. outlines: what to fit besides, if anything.
double descend(const Samples& s, const Inside& is_inside, SphereSet& spheres, Nearest& nearest,
               int iterations, float from, float to, OutlineFit* outlines = nullptr) {
  SphereSet best = spheres;
  double lowest = std::numeric_limits<double>::infinity();
  float moved = 0;
  std::vector<SphereEquations> equations;
  for (int k = 0; k <= iterations; ++k) {
    const float softness = from * std::pow(to / from, float(k) / float(iterations));
    find_nearest(s, spheres, nearest);
    equations.assign(spheres.size(), {});
    double now = cost(s, nearest);
    if (outlines) now += outlines->add_step(spheres, moved, softness, equations);
    if (now < lowest) lowest = now, best = spheres;
    if (k == iterations) break;
    add_step(s, nearest, spheres, softness, equations);
    moved += move_spheres(equations, is_inside, spheres);
  }
  spheres = best;
  find_nearest(s, spheres, nearest);
  return lowest;
}

// How much the cost rises without each sphere.
std::vector<double> worths(const Samples& s, const Nearest& nearest, std::size_t count) {
  std::vector<double> worth(count, 0);
  for (std::size_t i = 0; i < s.x.size(); ++i) {
    worth[std::size_t(nearest.sphere[i])] +=
        double(s.weight[i]) * (std::abs(nearest.second[i]) - std::abs(nearest.distance[i]));
    worth[std::size_t(nearest.intruder[i])] += double(s.weight[i] * nearest.depth[i]);
  }
  return worth;
}

// Where a sphere is missing most: cells of two voxels, by what is uncovered in the 27 around each.
class Uncovered {
 public:
  Uncovered(const Samples& s, std::size_t count, const VoxelGrid& grid)
      : s_(s),
        count_(count),
        size_(grid.size / 2 + 3),
        tried_(std::size_t(size_.x * size_.y * size_.z)) {}

  // The most uncovered point of the most uncovered place that was not yet given; the number of
  // points if there is none.
  std::size_t next(const Nearest& nearest) {
    std::vector<float> sums(tried_.size(), 0.0f);
    for (std::size_t i = 0; i < count_; ++i) sums[cell(i)] += loss(nearest, i);
    for (const int stride : {1, size_.x, size_.x * size_.y}) {
      std::vector<float> out = sums;
      for (std::size_t i = std::size_t(stride); i + std::size_t(stride) < sums.size(); ++i)
        out[i] += sums[i - std::size_t(stride)] + sums[i + std::size_t(stride)];
      sums.swap(out);
    }
    std::size_t place = sums.size();
    float most = 0;
    for (std::size_t i = 0; i < sums.size(); ++i)
      if (sums[i] > most && !tried_[i]) most = sums[i], place = i;
    if (place == sums.size()) return count_;
    std::size_t best = count_;
    for (std::size_t i = 0; i < count_; ++i)
      if (beside(cell(i), place) && (best == count_ || loss(nearest, i) > loss(nearest, best)))
        best = i;
    for (std::size_t i = 0; i < tried_.size(); ++i)
      if (beside(i, place)) tried_[i] = 1;
    return best;
  }

 private:
  float loss(const Nearest& nearest, std::size_t i) const {
    return s_.weight[i] * std::max(nearest.distance[i], 0.0f);
  }
  std::size_t cell(std::size_t i) const {
    const auto at = [](float v) { return int(std::max(v, 0.0f)) / 2 + 1; };
    return std::size_t((at(s_.z[i]) * size_.y + at(s_.y[i])) * size_.x + at(s_.x[i]));
  }
  bool beside(std::size_t a, std::size_t b) const {
    const int x = int(a) % size_.x - int(b) % size_.x,
              y = int(a) / size_.x % size_.y - int(b) / size_.x % size_.y,
              z = int(a) / (size_.x * size_.y) - int(b) / (size_.x * size_.y);
    return std::abs(x) <= 1 && std::abs(y) <= 1 && std::abs(z) <= 1;
  }

  const Samples& s_;
  std::size_t count_;
  glm::ivec3 size_;
  std::vector<std::uint8_t> tried_;
};

}  // namespace

SphereSet refine_spheres(SphereSet spheres, std::vector<SurfacePoint> points,
                         const std::vector<std::uint8_t>& inside, const VoxelGrid& grid,
                         const Outlines& outlines, const SphereRefineOptions& options) {
  if (spheres.empty() || points.empty()) return spheres;
  std::stable_sort(points.begin(), points.end(), [](const auto& a, const auto& b) {
    return morton(a.position) < morton(b.position);
  });
  const std::vector<float> weights = outline_weights(points);
  const Samples s = arrange(points, weights, outside_points(points, inside, grid, 4));
  const Inside is_inside{inside, grid};
  Nearest nearest;
  double lowest = descend(s, is_inside, spheres, nearest, options.iterations, 1.0f, 0.25f);
  Uncovered uncovered(s, points.size(), grid);
  for (int swap = 0; swap < options.swaps; ++swap) {
    const std::vector<double> worth = worths(s, nearest, spheres.size());
    const std::size_t least =
        std::size_t(std::min_element(worth.begin(), worth.end()) - worth.begin());
    const std::size_t where = uncovered.next(nearest);
    if (where == points.size()) break;
    const SurfacePoint& point = points[where];
    const float radius =
        std::clamp(std::min(0.5f * point.thickness, spheres[std::size_t(nearest.sphere[where])].w),
                   1.5f, 20.0f);
    SphereSet changed = spheres;
    changed[least] = {point.position - radius * point.normal, radius};
    Nearest after;
    const double now = descend(s, is_inside, changed, after, 8, 0.5f, 0.25f);
    if (now < lowest) lowest = now, spheres = changed, nearest = after;
  }
  OutlineFit fit(outlines);
  descend(s, is_inside, spheres, nearest, options.last_iterations, 0.5f, 0.1f, &fit);
  return spheres;
}

}  // namespace fastibl
