#include "fastibl/scene/cube_map.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

// ∫∫ dx dy / (1 + x² + y²)^{3/2} over [0, x] × [0, y]: the solid angle of a rectangle on the face
// plane.
double corner_angle(double x, double y) {
  return std::atan2(x * y, std::sqrt(x * x + y * y + 1.0));
}

// One axis of a reduction from n to m texels: source texels [first, first + weights) overlap target
// i.
struct Overlap {
  int first;
  std::vector<double> weights;
};

std::vector<Overlap> overlaps(int n, int m) {
  std::vector<Overlap> result(static_cast<std::size_t>(m));
  for (int i = 0; i < m; ++i) {
    const double begin = double(i) * n / m, end = double(i + 1) * n / m;
    Overlap& o = result[std::size_t(i)];
    o.first = int(std::floor(begin));
    for (int k = o.first; k < n && k < end; ++k)
      o.weights.push_back(std::min(end, k + 1.0) - std::max(begin, double(k)));
  }
  return result;
}

CubeLevel reduce(const CubeLevel& fine) {
  const int n = fine.size(), m = std::max(1, n / 2);
  CubeLevel coarse(m);
  const std::vector<double> angle = texel_solid_angles(n);
  if (n == 2 * m) {  // the usual case; the four weights of a texel are the same on all faces
    std::vector<float> weights(std::size_t(m) * m * 4);
    for (int y = 0; y < m; ++y)
      for (int x = 0; x < m; ++x) {
        const double* a = &angle[std::size_t(2 * y) * n + std::size_t(2 * x)];
        const double sum = a[0] + a[1] + a[n] + a[n + 1];
        float* w = &weights[(std::size_t(y) * m + std::size_t(x)) * 4];
        w[0] = float(a[0] / sum), w[1] = float(a[1] / sum);
        w[2] = float(a[n] / sum), w[3] = float(a[n + 1] / sum);
      }
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < m; ++y) {
        const glm::vec3* a = &fine.texel(f, 0, 2 * y);
        const glm::vec3* b = &fine.texel(f, 0, 2 * y + 1);
        const float* w = &weights[std::size_t(y) * m * 4];
        glm::vec3* out = &coarse.texel(f, 0, y);
        for (int x = 0; x < m; ++x, w += 4, a += 2, b += 2)
          out[x] = w[0] * a[0] + w[1] * a[1] + w[2] * b[0] + w[3] * b[1];
      }
  } else {
    const std::vector<Overlap> spans = overlaps(n, m);
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < m; ++y)
        for (int x = 0; x < m; ++x) {
          const Overlap &oy = spans[std::size_t(y)], &ox = spans[std::size_t(x)];
          glm::dvec3 sum(0);
          double total = 0;
          for (std::size_t j = 0; j < oy.weights.size(); ++j)
            for (std::size_t i = 0; i < ox.weights.size(); ++i) {
              const int sx = ox.first + int(i), sy = oy.first + int(j);
              const double w =
                  oy.weights[j] * ox.weights[i] * angle[std::size_t(sy) * n + std::size_t(sx)];
              sum += w * glm::dvec3(fine.texel(f, sx, sy));
              total += w;
            }
          coarse.texel(f, x, y) = glm::vec3(sum / total);
        }
  }
  coarse.update_border();
  return coarse;
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
  for (int y = 0; y <= n; ++y)
    for (int x = 0; x <= n; ++x)
      corners[std::size_t(y) * (n + 1) + std::size_t(x)] =
          corner_angle(2.0 * x / n - 1, 2.0 * y / n - 1);
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const double* c = &corners[std::size_t(y) * (n + 1) + std::size_t(x)];
      angles[std::size_t(y) * n + std::size_t(x)] = c[0] - c[1] - c[n + 1] + c[n + 2];
    }
  return angles;
}

CubeLevel::CubeLevel(int size)
    : size_(size), texels_(6 * std::size_t(size + 2) * std::size_t(size + 2) + 1, glm::vec3(0)) {}

void CubeLevel::update_border() {
  const int n = size_;
  // The texel one step across an edge, found by folding the direction of the imagined texel onto
  // the neighbour: exact, because both faces cut an edge into the same n parts.
  const auto across = [&](int face, int x, int y) -> const glm::vec3& {
    const float edge = 1e-4f / float(n);
    const float s = std::clamp((float(x) + 0.5f) / float(n), -edge, 1 + edge);
    const float t = std::clamp((float(y) + 0.5f) / float(n), -edge, 1 + edge);
    const FacePoint p = face_point(face_direction(face, s, t));
    return texel(p.face, std::clamp(int(p.s * float(n)), 0, n - 1),
                 std::clamp(int(p.t * float(n)), 0, n - 1));
  };
  for (int f = 0; f < 6; ++f) {
    for (int i = 0; i < n; ++i) {
      texel(f, i, -1) = across(f, i, -1);
      texel(f, i, n) = across(f, i, n);
      texel(f, -1, i) = across(f, -1, i);
      texel(f, n, i) = across(f, n, i);
    }
    for (const int y : {-1, n})
      for (const int x : {-1, n}) {
        const int ix = x < 0 ? 0 : n - 1, iy = y < 0 ? 0 : n - 1;
        texel(f, x, y) = (texel(f, ix, iy) + texel(f, ix, y) + texel(f, x, iy)) / 3.0f;
      }
  }
}

glm::vec3 CubeLevel::sample(glm::vec3 direction) const {
  const FacePoint p = face_point(direction);
  // Clamped because a direction of length 0 or NaN gives a NaN point; such a look-up is defined,
  // not useful. Comparisons instead of fmin and fmax, which are library calls.
  const float limit = float(size_);
  const auto clamped = [limit](float v) {
    return v > -0.5f ? (v < limit - 0.5f ? v : limit - 0.5f) : -0.5f;
  };
  const float x = clamped(p.s * limit - 0.5f), y = clamped(p.t * limit - 0.5f);
  const int ix = int(x + 1) - 1, iy = int(y + 1) - 1;  // floor for x ≥ −1
  const float fx = x - float(ix), fy = y - float(iy);
  const glm::vec3* a = &texel(p.face, ix, iy);
  const glm::vec3* b = a + row_stride();
  const glm::vec3 upper = a[0] + fx * (a[1] - a[0]), lower = b[0] + fx * (b[1] - b[0]);
  return upper + fy * (lower - upper);
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

CubeMap::CubeMap(int size, std::span<const glm::vec3> faces) {
  check(size >= 1, "faces must be at least 1 texel wide, got ", size);
  check(faces.size() == 6 * std::size_t(size) * std::size_t(size), "a cube map of size ", size,
        " needs ", 6 * std::size_t(size) * std::size_t(size), " texels, got ", faces.size());
  CubeLevel base(size);
  const glm::vec3* in = faces.data();
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < size; ++y)
      for (int x = 0; x < size; ++x, ++in)
        for (int c = 0; c < 3; ++c) base.texel(f, x, y)[c] = clean_radiance((*in)[c], cleaned_);
  base.update_border();
  levels_.push_back(std::move(base));
  while (levels_.back().size() > 1) levels_.push_back(reduce(levels_.back()));
}

const CubeLevel& CubeMap::level_at_most(int size) const {
  for (const CubeLevel& level : levels_)
    if (level.size() <= size) return level;
  return levels_.back();
}

glm::vec3 CubeMap::sample(glm::vec3 direction, float level) const {
  const float top = float(level_count() - 1);
  const float clamped = level > 0 ? (level < top ? level : top) : 0.0f;  // NaN gives 0
  const int k = std::min(int(clamped), level_count() - 1);
  const float f = clamped - float(k);
  const glm::vec3 fine = levels_[std::size_t(k)].sample(direction);
  if (f == 0) return fine;
  return fine + f * (levels_[std::size_t(k) + 1].sample(direction) - fine);
}

glm::dvec3 CubeMap::mean() const {
  glm::dvec3 sum(0);
  const CubeLevel& base = levels_.front();
  const std::vector<double> angle = texel_solid_angles(base.size());
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < base.size(); ++y)
      for (int x = 0; x < base.size(); ++x)
        sum +=
            angle[std::size_t(y) * base.size() + std::size_t(x)] * glm::dvec3(base.texel(f, x, y));
  return sum / (4 * std::numbers::pi);
}

}  // namespace fastibl
