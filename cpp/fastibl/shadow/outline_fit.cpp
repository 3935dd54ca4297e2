#include "fastibl/shadow/outline_fit.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "fastibl/core/lanes.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {
// Distance in voxels beyond which a point is just uncovered. Farther ones would draw spheres out of
// parts that they fit.
constexpr float kMost = 1.5f;
constexpr float kWeight = 2;  // against the points of the surface

// How far each of sixteen points is outside the union of discs (negative: inside), and the nearest
// disc. discs: (x, y, depth, radius), the `near` ones of them count. Rays begin at `start`.
template <typename V>
FASTIBL_INLINE void find_nearest_by(const float* x, const float* y, const float* start,
                                    const float* discs, const std::int32_t* near, int count,
                                    float* distance, std::int32_t* disc) {
  using Ints = IntsOf<V>;
  for (int at = 0; at < kLanes; at += kFloatsIn<V>) {
    const V px = floats_at<V>(x + at), py = floats_at<V>(y + at), pz = floats_at<V>(start + at);
    V best = V{} + kMost;
    Ints first{};
    for (int k = 0; k < count; ++k) {
      const float* s = discs + 4 * near[k];
      const V dx = px - s[0], dy = py - s[1], behind = pz - s[2];
      const V dz = behind > 0 ? behind : V{};
      const V squared = dx * dx + dy * dy + dz * dz;
      V d;
      for (int i = 0; i < kFloatsIn<V>; ++i) d[i] = __builtin_sqrtf(squared[i]);
      d -= s[3];
      const Ints nearer = d < best;
      best = nearer ? d : best;
      first = nearer ? Ints{} + near[k] : first;
    }
    put_floats(best, distance + at);
    std::memcpy(disc + at, &first, sizeof first);
  }
}
FASTIBL_BY_WIDTH(void find_nearest(const float* x, const float* y, const float* start,
                                   const float* discs, const std::int32_t* near, int count,
                                   float* distance, std::int32_t* disc),
                 find_nearest_by<V>(x, y, start, discs, near, count, distance, disc))

void add_turned(const SphereEquations& q, const glm::dmat3& axes, SphereEquations& sum) {
  if (!(q.weight > 0)) return;
  const auto& m = q.matrix;
  const glm::dmat3 centre(m[0], m[4], m[8], m[4], m[5], m[9], m[8], m[9], m[10]);
  const glm::dmat3 turned = axes * centre * glm::transpose(axes);
  const glm::dvec3 mixed = axes * glm::dvec3(m[12], m[13], m[14]),
                   right = axes * glm::dvec3(q.right[0], q.right[1], q.right[2]);
  for (int a = 0; a < 3; ++a) {
    for (int b = 0; b <= a; ++b) sum.matrix[std::size_t(4 * a + b)] += turned[b][a];
    sum.matrix[std::size_t(12 + a)] += mixed[a];
    sum.right[std::size_t(a)] += right[a];
  }
  sum.matrix[15] += m[15];
  sum.right[3] += q.right[3];
  sum.weight += q.weight;
}

}  // namespace

OutlineFit::OutlineFit(const Outlines& outlines)
    : outlines_(outlines),
      covered_until_(outlines.within.size(), -1.0f),
      views_(outlines.views.size()) {}

double OutlineFit::add_step(const SphereSet& spheres, float moved, float softness,
                            std::vector<SphereEquations>& equations) {
  parallel_for(int(views_.size()), 1, [&](int begin, int end) {
    for (int v = begin; v < end; ++v) measure(std::size_t(v), spheres, moved, softness);
  });
  double cost = 0;
  for (std::size_t v = 0; v < views_.size(); ++v) {
    cost += views_[v].cost;
    const OutlineView& view = outlines_.views[v];
    const glm::dmat3 axes(glm::dvec3(view.across), glm::dvec3(view.up),
                          glm::dvec3(view.towards_light));
    for (std::size_t j = 0; j < spheres.size(); ++j)
      add_turned(views_[v].equations[j], axes, equations[j]);
  }
  return cost;
}

void OutlineFit::measure(std::size_t v, const SphereSet& spheres, float moved, float softness) {
  const OutlineView& view = outlines_.views[v];
  View& fit = views_[v];
  fit.cost = 0;
  fit.equations.assign(spheres.size(), {});
  std::vector<float> discs;
  for (const glm::vec4& s : spheres) {
    discs.push_back(glm::dot(glm::vec3(s), view.across));
    discs.push_back(glm::dot(glm::vec3(s), view.up));
    discs.push_back(glm::dot(glm::vec3(s), view.towards_light));
    discs.push_back(s.w);
  }
  std::vector<std::int32_t> near(spheres.size() + 1);
  for (int b = view.first; b < view.first + view.blocks; ++b) {
    const std::size_t block = std::size_t(b), at = block * kLanes;
    // No sphere has come far enough to uncover one of these.
    if (moved < covered_until_[block]) continue;
    int count = 0;
    const glm::vec3 bounds = outlines_.bounds[block];
    for (int j = 0; j < int(spheres.size()); ++j) {
      const float* s = &discs[std::size_t(4 * j)];
      const float dx = bounds.x - s[0], dy = bounds.y - s[1], reach = bounds.z + s[3] + kMost;
      near[std::size_t(count)] = j;
      count += dx * dx + dy * dy < reach * reach;
    }
    float start[kLanes], distance[kLanes];
    std::int32_t disc[kLanes];
    for (std::size_t i = 0; i < kLanes; ++i)
      start[i] = view.start.x + view.start.y * outlines_.y[at + i];
    find_nearest(&outlines_.x[at], &outlines_.y[at], start, discs.data(), near.data(), count,
                 distance, disc);
    const bool within = outlines_.within[block];
    float farthest = -kMost;
    for (std::size_t i = 0; i < kLanes; ++i) {
      farthest = std::max(farthest, distance[i]);
      if (within && distance[i] < 0) continue;
      const float weight = kWeight * outlines_.weight[at + i];
      fit.cost += double(weight * std::abs(distance[i]));
      if (distance[i] < kMost) {
        const float* s = &discs[std::size_t(4 * disc[i])];
        // Away from the centre is the nearest point of the ray.
        fit.equations[std::size_t(disc[i])].add(
            {outlines_.x[at + i] - s[0], outlines_.y[at + i] - s[1],
             std::max(start[i] - s[2], 0.0f)},
            s[3], distance[i], weight / std::sqrt(distance[i] * distance[i] + softness * softness));
      }
    }
    if (within && farthest < 0) covered_until_[block] = moved - farthest;
  }
}

}  // namespace fastibl
