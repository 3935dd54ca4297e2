#include "fastibl/lighting/lobe_quadtree.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/cube_symmetry.h"

namespace fastibl {
namespace {

float brightness(glm::vec3 v) { return (v.x + v.y + v.z) / 3; }

// Directions and solid angles of the finest level.
void set_finest(QuadtreeLevel& level) {
  const int n = level.size;
  const std::size_t count = std::size_t(n) * n;
  level.x.resize(count), level.y.resize(count), level.z.resize(count);
  level.deficit.assign(count, 0);
  const std::vector<double> angle = texel_solid_angles(n);
  level.angle.assign(angle.begin(), angle.end());
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const double s = (2.0 * x + 1) / n - 1, t = (2.0 * y + 1) / n - 1;
      const double scale = 1 / std::sqrt(1 + s * s + t * t);
      const std::size_t i = std::size_t(y) * n + std::size_t(x);
      level.x[i] = float(s * scale), level.y[i] = float(t * scale), level.z[i] = float(scale);
    }
}

// Means over four texels, weighted by their solid angles.
void set_coarser(QuadtreeLevel& coarse, const QuadtreeLevel& fine) {
  const int n = coarse.size;
  const std::size_t count = std::size_t(n) * n;
  coarse.x.resize(count), coarse.y.resize(count), coarse.z.resize(count);
  coarse.deficit.resize(count), coarse.angle.resize(count);
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const std::size_t a = std::size_t(2 * y) * fine.size + std::size_t(2 * x);
      const std::size_t children[4] = {a, a + 1, a + std::size_t(fine.size),
                                       a + std::size_t(fine.size) + 1};
      double w = 0, deficit = 0;
      glm::dvec3 mean(0);
      for (const std::size_t c : children) {
        w += fine.angle[c];
        mean += double(fine.angle[c]) * glm::dvec3(fine.x[c], fine.y[c], fine.z[c]);
      }
      mean /= w;
      // (1 − |mean|²)/2 without cancellation: the children's own, and their spread about the mean.
      for (const std::size_t c : children) {
        const glm::dvec3 d = glm::dvec3(fine.x[c], fine.y[c], fine.z[c]) - mean;
        deficit += fine.angle[c] / w * (fine.deficit[c] + glm::dot(d, d) / 2);
      }
      const std::size_t i = std::size_t(y) * n + std::size_t(x);
      coarse.x[i] = float(mean.x), coarse.y[i] = float(mean.y), coarse.z[i] = float(mean.z);
      coarse.deficit[i] = float(deficit), coarse.angle[i] = float(w);
    }
}

// Replaces each value by the largest among the images of its texel.
void spread_largest(std::vector<float>& values, int n) {
  const auto symmetries = cube_symmetries(n, n, std::ptrdiff_t(n) * n);
  for (const Texel& texel : fundamental_texels(n)) {
    float largest = 0;
    for (const CubeSymmetry& g : symmetries)
      largest = std::max(largest, values[std::size_t(g[4](texel.x, texel.y))]);
    for (const CubeSymmetry& g : symmetries) values[std::size_t(g[4](texel.x, texel.y))] = largest;
  }
}

// A bound of Σ ω |L − mean| over all texels below: the sum of the steps from level to level.
std::vector<float> unevenness(const QuadtreeLevel& coarse, const QuadtreeLevel& fine,
                              const std::vector<float>& below) {
  const int n = coarse.size, m = fine.size;
  std::vector<float> result(6 * std::size_t(n) * n);
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const glm::vec3 mean = coarse.radiance->texel(f, x, y);
        float sum = 0;
        for (int j = 0; j < 2; ++j)
          for (int i = 0; i < 2; ++i) {
            const std::size_t at = std::size_t(2 * y + j) * m + std::size_t(2 * x + i);
            const glm::vec3 step = glm::abs(fine.radiance->texel(f, 2 * x + i, 2 * y + j) - mean);
            sum += fine.angle[at] * brightness(step);
            if (!below.empty()) sum += below[std::size_t(f) * m * m + at];
          }
        result[(std::size_t(f) * n + std::size_t(y)) * n + std::size_t(x)] = sum;
      }
  return result;
}

// Takes the largest of all images, and more where light is concentrated: errors of many texels
// average out, but that of a lone sun does not.
void set_unevenness(QuadtreeLevel& level, std::vector<float> uneven) {
  double mean = 0;
  for (const float u : uneven) mean += double(u) / double(uneven.size());
  spread_largest(uneven, level.size);
  if (mean > 0)
    for (float& u : uneven) u *= std::clamp(u / float(32 * mean), 1.0f, 8.0f);
  level.unevenness = std::move(uneven);
}

// Sets every texel's flux, and its unevenness times √ω: both relative to the mean, and the largest
// of all images. Dark texels count like the mean, because the lobe's integral over them scales
// every result.
void set_light(QuadtreeLevel& level, std::vector<float> uneven, float mean) {
  const std::size_t count = std::size_t(level.size) * level.size;
  level.flux.resize(6 * count);
  const float scale = mean > 0 ? 1 / mean : 0;
  for (int f = 0; f < 6; ++f)
    for (std::size_t i = 0; i < count; ++i) {
      const int x = int(i) % level.size, y = int(i) / level.size;
      const float w = level.angle[i];
      const std::size_t k = std::size_t(f) * count + i;
      level.flux[k] = w * std::max(1.0f, scale * brightness(level.radiance->texel(f, x, y)));
      if (!uneven.empty()) uneven[k] *= scale * std::sqrt(w);
    }
  spread_largest(level.flux, level.size);
  if (!uneven.empty()) set_unevenness(level, std::move(uneven));
}

// A unit direction in the frame of a face.
glm::vec3 in_face(glm::vec3 d, int face) {
  const glm::vec3 major = face_direction(face, 0.5f, 0.5f);
  return {glm::dot(d, face_direction(face, 1, 0.5f) - major),
          glm::dot(d, face_direction(face, 0.5f, 1) - major), glm::dot(d, major)};
}

// How many steps of the lobe's table a texel and a group of directions can be off.
int reach_in_steps(const LobeTable& lobe, float angle) {
  return int(lobe.steps * angle * 0.70710678f) + 1;  // dr/dθ ≤ 1/√2
}

enum class Fate { keep, cut, leave_out };

Fate fate(const LobeTable& lobe, const QuadtreeLevel& level, std::size_t texel, std::size_t image,
          glm::vec3 d, int reach, bool finest, const ChoiceLimits& limits) {
  const float dx = d.x - level.x[texel], dy = d.y - level.y[texel], dz = d.z - level.z[texel];
  const float t = level.deficit[texel] + 0.5f * (dx * dx + dy * dy + dz * dz);
  const int at = int(std::sqrt(t) * lobe.steps), end = int(lobe.steps);
  const int low = std::max(at - reach, 0), high = std::min(at + reach + 1, end);
  if (low >= end || lobe.height[std::size_t(low)] * level.flux[image] <= limits.flux)
    return Fate::leave_out;
  if (finest) return Fate::keep;
  const float slope = low > lobe.steepest    ? lobe.slope[std::size_t(low)]
                      : high < lobe.steepest ? lobe.slope[std::size_t(high)]
                                             : lobe.slope[std::size_t(lobe.steepest)];
  // In an even part of the map the lobe's height at the mean direction stands for its mean over the
  // texel. This is off by the second derivative times ω/12.
  const float curved = lobe.slope[std::size_t(lobe.steepest)] / 12 * level.angle[texel];
  return slope * (level.unevenness[image] + curved * level.flux[image]) <= limits.unevenness
             ? Fate::keep
             : Fate::cut;
}

}  // namespace

CubeMap resampled(const CubeMap& map, int size) {
  const int n = map.size();
  struct Piece {
    int texel;
    double middle, width;  // on the face, whose edges are −1 and 1
  };
  std::vector<std::vector<Piece>> pieces(static_cast<std::size_t>(size));
  for (int i = 0; i < size; ++i)
    for (int k = int(std::int64_t(i) * n / size); k < n; ++k) {
      const double begin = std::max(double(k) / n, double(i) / size);
      const double end = std::min(double(k + 1) / n, double(i + 1) / size);
      if (double(k) / n >= double(i + 1) / size) break;
      if (end > begin) pieces[std::size_t(i)].push_back({k, begin + end - 1, 2 * (end - begin)});
    }
  std::vector<glm::vec3> faces(6 * std::size_t(size) * size);
  parallel_for(6 * size, 8, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int x = 0; x < size; ++x) {
        glm::dvec3 sum(0);
        double total = 0;
        for (const Piece& t : pieces[std::size_t(row % size)])
          for (const Piece& s : pieces[std::size_t(x)]) {
            // Solid angle of a small piece, dω = dA / |p|³.
            const double w =
                s.width * t.width * std::pow(1 + s.middle * s.middle + t.middle * t.middle, -1.5);
            sum += w * glm::dvec3(map.level(0).texel(row / size, s.texel, t.texel));
            total += w;
          }
        faces[std::size_t(row) * size + std::size_t(x)] = glm::vec3(sum / total);
      }
  });
  return CubeMap(size, faces);
}

CubeQuadtree::CubeQuadtree(std::shared_ptr<const CubeMap> map, int finest) {
  const int size = int(std::bit_ceil(unsigned(std::max(map->size(), finest))));
  map_ =
      size == map->size() ? std::move(map) : std::make_shared<const CubeMap>(resampled(*map, size));
  const float mean = float(brightness(glm::vec3(map_->mean())));
  std::vector<float> uneven;
  for (int k = 0; k < map_->level_count(); ++k) {
    QuadtreeLevel level;
    level.size = map_->level(k).size();
    level.radiance = &map_->level(k);
    // Half a diagonal in the middle of a face, where texels are widest.
    level.reach = std::atan(1.4142136f / float(level.size));
    if (k == 0) {
      set_finest(level);
    } else {
      set_coarser(level, levels_.back());
      uneven = unevenness(level, levels_.back(), uneven);
    }
    set_light(level, uneven, mean);
    levels_.push_back(std::move(level));
  }
}

TexelChoice choose_texels(const CubeQuadtree& tree, const LobeTable& lobe, glm::vec3 direction,
                          float spread, const ChoiceLimits& limits) {
  TexelChoice choice;
  const int coarsest = std::max(0, int(tree.levels().size()) - 3);  // 4²: none above is ever kept
  std::vector<std::uint32_t> now, next;
  for (int f = 0; f < 6; ++f) {
    const glm::vec3 d = in_face(direction, f);
    const int edge = tree.levels()[std::size_t(coarsest)].size;
    now.clear();
    for (int i = 0; i < edge * edge; ++i) now.push_back(std::uint32_t(i));
    for (int k = coarsest; k >= 0 && !now.empty(); --k) {
      const QuadtreeLevel& level = tree.levels()[std::size_t(k)];
      const int n = level.size, reach = reach_in_steps(lobe, level.reach + spread);
      const std::size_t first = choice.texels.size();
      next.clear();
      for (const std::uint32_t i : now) {
        const std::size_t image = std::size_t(f) * n * n + i;
        const Fate what = fate(lobe, level, i, image, d, reach, k == 0, limits);
        if (what == Fate::keep) choice.texels.push_back(i);
        if (what != Fate::cut) continue;
        const std::uint32_t x = i % std::uint32_t(n), y = i / std::uint32_t(n);
        const std::uint32_t child = 4 * y * std::uint32_t(n) + 2 * x;
        const std::uint32_t below = child + 2 * std::uint32_t(n);
        next.insert(next.end(), {child, child + 1, below, below + 1});
      }
      if (choice.texels.size() > first)
        choice.runs.push_back({k, f, first, choice.texels.size() - first});
      std::swap(now, next);
    }
  }
  return choice;
}

}  // namespace fastibl
