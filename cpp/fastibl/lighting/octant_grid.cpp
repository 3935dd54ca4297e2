#include "fastibl/lighting/octant_grid.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <mutex>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kLeast = 16;       // at least this many texels along an edge are summed over
constexpr int kVectorSize = 64;  // a linear gradient in the map is right within 1e-4 from here on

OctantGrid make_grid(int size) {
  OctantGrid grid;
  grid.size = size;
  const CubeLevel layout(size);
  grid.octant_texels.resize(std::size_t(6 * size * size));
  for (int face = 0; face < 6; face += 2)
    for (int ty = 0; ty < size; ++ty)
      for (int tx = 0; tx < size; ++tx) {
        const glm::vec3 d = texel_direction(face, tx, ty, size);
        if (d.x < 0 || d.y < 0 || d.z < 0) continue;
        const glm::dvec3 unit = glm::normalize(glm::dvec3(d));
        grid.x.push_back(float(unit.x));
        grid.y.push_back(float(unit.y));
        grid.z.push_back(float(unit.z));
        const double angle = texel_solid_angle(tx, ty, size);
        grid.solid_angle.push_back(float(angle));
        const double x = unit.x, y = unit.y, z = unit.z;
        // Those of bands 0 and 2, without their constants.
        const double even[6] = {1, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y};
        for (std::size_t i = 0; i < 6; ++i)
          grid.even_harmonics[i].push_back(float(angle * even[i]));
        grid.projected.push_back(float(angle * z));
        // A step of 1/size on the face at distance 1 is seen from |d|, along s and along t.
        const double length2 = double(glm::dot(d, d)), step = 1.0 / size;
        const FacePoint p = face_point(d);
        const double a = 2 * double(p.s) - 1, b = 2 * double(p.t) - 1;
        const double along_s = step * std::sqrt(1 + b * b) / length2,
                     along_t = step * std::sqrt(1 + a * a) / length2;
        grid.half_width.push_back(float(std::sqrt((along_s * along_s + along_t * along_t) / 2)));
        for (int image = 0; image < 8; ++image) {
          const FacePoint at =
              face_point({image & 1 ? -d.x : d.x, image & 2 ? -d.y : d.y, image & 4 ? -d.z : d.z});
          const auto [of, s, t] = texel_at(at, size);
          grid.texels[std::size_t(image)].push_back(int(&layout.texel(of, s, t) - layout.face(0)));
          grid.octant_texels[std::size_t((of * size + t) * size + s)] = int(grid.x.size()) - 1;
        }
      }
  return grid;
}

// The level with each texel cut into `split` × `split`.
CubeLevel cut(const CubeLevel& level, int split) {
  CubeLevel fine(level.size() * split);
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < fine.size(); ++y)
      for (int x = 0; x < fine.size(); ++x)
        fine.texel(f, x, y) = level.texel(f, x / split, y / split);
  return fine;
}

void fold_into(FoldedMap& folded, const CubeLevel& level) {
  const OctantGrid& grid = *folded.grid;
  const std::size_t count = grid.x.size();
  for (auto& pattern : folded.radiance)
    for (auto& channel : pattern) channel.resize(count);
  const glm::vec3* texels = level.face(0);
  for (std::size_t i = 0; i < count; ++i) {
    const auto both = [&](std::size_t image) {
      return texels[grid.texels[image][i]] + texels[grid.texels[7 - image][i]];
    };
    const glm::vec3 self = both(0), in_x = both(1), in_y = both(2), in_z = both(4);
    const glm::vec3 a = self + in_x, b = in_y + in_z, c = self - in_x, d = in_y - in_z;
    const glm::vec3 patterns[4] = {a + b, a - b, c + d, c - d};
    for (std::size_t p = 0; p < 4; ++p)
      for (std::size_t k = 0; k < 3; ++k) folded.radiance[p][k][i] = patterns[p][int(k)];
  }
}

// Takes a small light out of the texels that its texel of a level was cut into.
void take_out(const SmallLight& light, const CubeLevel& level, FoldedMap& folded) {
  const OctantGrid& grid = *folded.grid;
  const int split = grid.size / level.size();
  const auto [face, x, y] = light.texel;
  const glm::vec3 radiance(light.flux / texel_solid_angle(x, y, level.size()));
  for (int t = y * split; t < (y + 1) * split; ++t)
    for (int s = x * split; s < (x + 1) * split; ++s) {
      const auto i =
          std::size_t(grid.octant_texels[std::size_t((face * grid.size + t) * grid.size + s)]);
      const glm::vec3 d = texel_direction(face, s, t, grid.size);
      const std::size_t image = kEvenImage[(d.x < 0) | (d.y < 0) << 1 | (d.z < 0) << 2];
      for (std::size_t p = 0; p < 4; ++p)
        for (std::size_t c = 0; c < 3; ++c)
          folded.radiance[p][c][i] -= float(kSigns[p][image]) * radiance[int(c)];
    }
}

constexpr int kRowSums = 24;  // eight texels of three channels at once

// Adds a row of texels, each times two weights, and the first sum times t, the row's place on the
// face. sums: kRowSums of each.
FASTIBL_CLONES
void add_row(const float* row, const float* weights, const float* moments, int count, float t,
             float* __restrict sums) {
  float a[kRowSums] = {}, b[kRowSums] = {};
  for (int i = 0; i + kRowSums <= count; i += kRowSums)
    for (int k = 0; k < kRowSums; ++k) {
      a[k] += weights[i + k] * row[i + k];
      b[k] += moments[i + k] * row[i + k];
    }
  for (int i = count - count % kRowSums; i < count; ++i) {
    a[i % 3] += weights[i] * row[i];
    b[i % 3] += moments[i] * row[i];
  }
  for (int k = 0; k < kRowSums; ++k) {
    sums[k] += a[k];
    sums[kRowSums + k] += b[k];
    sums[2 * kRowSums + k] += t * a[k];
  }
}

// Weights of a face's texels for add_row: solid angle over the distance, and that times s in
// [−1, 1]; three of each, one per channel.
struct VectorWeights {
  std::vector<float> weights, moments;

  explicit VectorWeights(int n) {
    const std::vector<double> angles = texel_solid_angles(n);
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const double a = (2.0 * x + 1) / n - 1, b = (2.0 * y + 1) / n - 1;
        const double w = angles[std::size_t(y) * n + std::size_t(x)] / std::sqrt(1 + a * a + b * b);
        for (int c = 0; c < 3; ++c) weights.push_back(float(w)), moments.push_back(float(w * a));
      }
  }
};

// One of each size, never destroyed: threads may outlive static objects.
template <typename Table, typename Make>
const Table& kept(int size, Make make) {
  static std::mutex mutex;
  static auto* tables = new std::map<int, std::unique_ptr<const Table>>;
  const std::lock_guard lock(mutex);
  std::unique_ptr<const Table>& table = (*tables)[size];
  if (!table) table = std::make_unique<const Table>(make(size));
  return *table;
}

std::array<glm::dvec3, 3> vector_irradiance(const CubeLevel& level) {
  const int n = level.size();
  const VectorWeights& weights =
      kept<VectorWeights>(n, [](int size) { return VectorWeights(size); });
  std::array<glm::dvec3, 3> result{};
  for (int f = 0; f < 6; ++f) {
    float sums[3 * kRowSums] = {};
    for (int y = 0; y < n; ++y) {
      const std::size_t first = std::size_t(y) * n * 3;
      add_row(&level.texel(f, 0, y).x, &weights.weights[first], &weights.moments[first], 3 * n,
              float(2 * y + 1) / float(n) - 1, sums);
    }
    glm::dvec3 moments[3] = {};  // by 1, s and t in [−1, 1], in which a direction is linear
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < kRowSums; ++k) moments[i][k % 3] += double(sums[i * kRowSums + k]);
    const glm::dvec3 centre(face_direction(f, 0.5f, 0.5f)),
        along_s = glm::dvec3(face_direction(f, 1, 0.5f)) - centre,
        along_t = glm::dvec3(face_direction(f, 0.5f, 1)) - centre;
    for (int axis = 0; axis < 3; ++axis)
      result[std::size_t(axis)] +=
          centre[axis] * moments[0] + along_s[axis] * moments[1] + along_t[axis] * moments[2];
  }
  return result;
}

}  // namespace

const OctantGrid& octant_grid(int size) { return kept<OctantGrid>(size, make_grid); }

FoldedMap fold(const CubeMap& radiance, int size) {
  const CubeLevel& level = radiance.level_at_most(size);
  int split = (kLeast + level.size() - 1) / level.size();
  if (level.size() * split % 2 != 0) ++split;
  FoldedMap folded;
  folded.grid = &octant_grid(level.size() * split);
  if (split == 1)
    fold_into(folded, level);
  else
    fold_into(folded, cut(level, split));
  const CubeLevel& fine = radiance.level_at_most(kVectorSize);
  folded.vector = vector_irradiance(
      fine.size() < kLeast ? cut(fine, (kLeast + fine.size() - 1) / fine.size()) : fine);
  if (split > 1 && level.size() == radiance.size()) return folded;  // its texels are seen as areas
  SmallLights small = small_lights(radiance, level, fine.size());
  for (std::size_t axis = 0; axis < 3; ++axis) folded.vector[axis] += small.shift[axis];
  folded.small_lights = std::move(small.lights);
  for (const SmallLight& light : folded.small_lights) take_out(light, level, folded);
  return folded;
}

}  // namespace fastibl
