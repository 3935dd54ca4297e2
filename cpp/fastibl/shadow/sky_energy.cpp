#include "fastibl/shadow/sky_energy.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <mutex>

#include "fastibl/core/check.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {
namespace {

constexpr int kLeastSize = 16;
constexpr double kHorizon = 1e-3;  // z below which light hardly reaches the plane, and shadows are
                                   // a thousand times as long as what casts them

using Double4 [[gnu::vector_size(32), gnu::may_alias]] = double;

// The texels of a face that are above the horizon.
struct FaceTexels {
  int x0, y0, width, height;
  std::vector<float> cosines;  // solid angle × z, 0 near the horizon
};
using SkyTexels = std::array<FaceTexels, kSkyFaces>;

std::shared_ptr<const SkyTexels> make_texels(int n) {
  auto texels = std::make_shared<SkyTexels>();
  const int h = n / 2;
  // z falls to the right of +x, rises on −x, rises downwards on +y and falls on −y.
  const int rects[kSkyFaces][4] = {
      {0, 0, h, n}, {h, 0, h, n}, {0, h, n, h}, {0, 0, n, h}, {0, 0, n, n}};
  const std::vector<double> angles = texel_solid_angles(n);
  for (int f = 0; f < kSkyFaces; ++f) {
    FaceTexels& t = (*texels)[std::size_t(f)];
    t = {rects[f][0], rects[f][1], rects[f][2], rects[f][3], {}};
    for (int y = t.y0; y < t.y0 + t.height; ++y)
      for (int x = t.x0; x < t.x0 + t.width; ++x) {
        const glm::vec3 d = glm::normalize(texel_direction(f, x, y, n));
        t.cosines.push_back(d.z > kHorizon ? float(angles[std::size_t(y) * n + x] * d.z) : 0);
      }
  }
  return texels;
}

// Kept for the sizes in use.
std::shared_ptr<const SkyTexels> sky_texels(int size) {
  static std::mutex mutex;
  static std::map<int, std::shared_ptr<const SkyTexels>> kept;
  const std::lock_guard lock(mutex);
  std::shared_ptr<const SkyTexels>& texels = kept[size];
  if (!texels) texels = make_texels(size);
  return texels;
}

FASTIBL_CLONES
void scale_row(const glm::vec3* radiance, const float* cosines, int count, glm::vec3* energy,
               double* sum) {
  float r = 0, g = 0, b = 0;
  for (int x = 0; x < count; ++x) {
    energy[x].x = radiance[x].x * cosines[x], r += energy[x].x;
    energy[x].y = radiance[x].y * cosines[x], g += energy[x].y;
    energy[x].z = radiance[x].z * cosines[x], b += energy[x].z;
  }
  sum[0] += r, sum[1] += g, sum[2] += b;
}

// The largest of the channels' shares, and the sum of these.
FASTIBL_CLONES
double largest_shares(const glm::vec3* energy, int count, const float* inverse, float* shares) {
  for (int i = 0; i < count; ++i) {
    const float r = energy[i].x * inverse[0], g = energy[i].y * inverse[1],
                b = energy[i].z * inverse[2];
    const float most = r > g ? r : g;
    shares[i] = most > b ? most : b;
  }
  double lanes[8] = {};
  int i = 0;
  for (; i + 8 <= count; i += 8)
    for (int k = 0; k < 8; ++k) lanes[k] += shares[i + k];
  double sum = 0;
  for (; i < count; ++i) sum += shares[i];
  for (const double lane : lanes) sum += lane;
  return sum;
}

// Sums of (width + 1) × (height + 1), of which the first row and column are 0.
FASTIBL_CLONES
void integrate(const glm::vec3* energy, int width, int height, const double* inverse,
               double* sums) {
  for (int y = 0; y < height; ++y, energy += width) {
    Double4 row{};
    const double* above = sums + 4 * (std::size_t(y) * std::size_t(width + 1) + 1);
    double* out = sums + 4 * (std::size_t(y + 1) * std::size_t(width + 1) + 1);
    for (int x = 0; x < width; ++x, above += 4, out += 4) {
      const glm::vec3 e = energy[x];
      const double r = e.x * inverse[0], g = e.y * inverse[1], b = e.z * inverse[2];
      row += Double4{r, g, b, std::max(std::max(r, g), b)};
      *reinterpret_cast<Double4*>(out) = row + *reinterpret_cast<const Double4*>(above);
    }
  }
}

}  // namespace

SkyEnergy::SkyEnergy(const CubeMap& radiance, double brightest) {
  read(radiance);
  float inverse[3];
  for (int c = 0; c < 3; ++c) inverse[c] = irradiance_[c] > 0 ? float(1 / irradiance_[c]) : 0;
  std::vector<float> weights[kSkyFaces];
  double total = 0;
  for (int f = 0; f < kSkyFaces; ++f) {
    weights[f].resize(energies_[f].size());
    total +=
        largest_shares(energies_[f].data(), int(energies_[f].size()), inverse, weights[f].data());
  }
  const auto texels = sky_texels(size_);
  for (int f = 0; f < kSkyFaces && finest_ < level_; ++f) {
    const FaceTexels& t = (*texels)[std::size_t(f)];
    for (std::size_t i = 0; i < weights[f].size(); ++i)
      if (weights[f][i] > float(brightest * total))
        bright_.push_back({f, t.x0 + int(i) % t.width, t.y0 + int(i) / t.width});
  }
  make_tables(radiance);
}

SkyEnergy::SkyEnergy(const CubeMap& radiance, std::span<const BrightTexel> bright)
    : bright_(bright.begin(), bright.end()) {
  read(radiance);
  make_tables(radiance);
}

// Energy of each texel of the level that is summed.
void SkyEnergy::read(const CubeMap& map) {
  check(map.size() > 0, "the radiance map is empty");
  while (map.level(level_).size() > kSkyLevel) ++level_;
  finest_ = level_;
  while (finest_ > 0 && map.level(finest_ - 1).size() == 2 * map.level(finest_).size()) --finest_;
  const CubeLevel& radiance = map.level(level_);
  // Texels are split where they are few or odd in number, so that the horizon is an edge of texels.
  const int n = radiance.size();
  parts_ = (kLeastSize + n - 1) / n;
  if (n * parts_ % 2 == 1) ++parts_;
  size_ = n * parts_;
  const auto texels = sky_texels(size_);
  std::vector<glm::vec3> wide(parts_ > 1 ? std::size_t(size_) : 0);
  for (int f = 0; f < kSkyFaces; ++f) {
    const FaceTexels& t = (*texels)[std::size_t(f)];
    energies_[f].resize(t.cosines.size());
    for (int y = 0; y < t.height; ++y) {
      const glm::vec3* row = radiance.face(f) + ((t.y0 + y) / parts_) * radiance.row_stride();
      if (parts_ > 1) {
        for (int x = 0; x < size_; ++x) wide[std::size_t(x)] = row[x / parts_];
        row = wide.data();
      }
      const std::size_t first = std::size_t(y) * std::size_t(t.width);
      scale_row(row + t.x0, &t.cosines[first], t.width, &energies_[f][first], &irradiance_[0]);
    }
  }
  for (int c = 0; c < 3; ++c)
    if (!(irradiance_[c] > kLeastIrradiance)) irradiance_[c] = 0;
}

void SkyEnergy::make_tables(const CubeMap& radiance) {
  double inverse[3];
  for (int c = 0; c < 3; ++c) inverse[c] = irradiance_[c] > 0 ? 1 / irradiance_[c] : 0;
  const auto texels = sky_texels(size_);
  for (const BrightTexel& b : bright_) {
    const FaceTexels& t = (*texels)[std::size_t(b.face)];
    energies_[b.face][std::size_t((b.y - t.y0) * t.width + b.x - t.x0)] = glm::vec3(0);
  }
  for (int f = 0; f < kSkyFaces; ++f) {
    const FaceTexels& t = (*texels)[std::size_t(f)];
    Table table{f, size_, t.x0, t.y0, t.width, t.height, {}};
    table.sums.resize(std::size_t(t.width + 1) * std::size_t(t.height + 1));
    integrate(energies_[f].data(), t.width, t.height, inverse, table.sums[0].value);
    tables_.push_back(std::move(table));
    energies_[f] = {};
  }
  for (const BrightTexel& b : bright_) tables_.push_back(bright_table(radiance, b, inverse));
}

SkyEnergy::Table SkyEnergy::bright_table(const CubeMap& radiance, const BrightTexel& texel,
                                         const double* inverse) const {
  const CubeLevel& fine = radiance.level(finest_);
  const int n = 1 << (level_ - finest_);
  Table table{texel.face, fine.size(), texel.x * n, texel.y * n, n, n, {}};
  table.sums.resize(std::size_t(n + 1) * std::size_t(n + 1));
  std::vector<glm::vec3> energies;
  for (int y = table.y0; y < table.y0 + n; ++y)
    for (int x = table.x0; x < table.x0 + n; ++x) {
      const glm::vec3 d = glm::normalize(texel_direction(texel.face, x, y, fine.size()));
      const float cosine = float(texel_solid_angle(x, y, fine.size())) * d.z;
      energies.push_back(fine.texel(texel.face, x, y) * (d.z > kHorizon ? cosine : 0));
    }
  integrate(energies.data(), n, n, inverse, table.sums[0].value);
  return table;
}

SkyRect SkyEnergy::whole(int index) const {
  const Table& t = tables_[std::size_t(index)];
  return {index, double(t.x0), double(t.y0), double(t.x0 + t.width), double(t.y0 + t.height)};
}

// The sums are bilinear within a texel, as if its light were spread evenly over it.
SkyEnergy::Sum SkyEnergy::before(const Table& table, double x, double y) {
  x -= table.x0, y -= table.y0;
  const int ix = std::clamp(int(x), 0, table.width - 1),
            iy = std::clamp(int(y), 0, table.height - 1);
  const double fx = x - ix, fy = y - iy;
  const Sum* a = &table.sums[std::size_t(iy) * std::size_t(table.width + 1) + std::size_t(ix)];
  const Sum* b = a + table.width + 1;
  Sum out;
  for (int k = 0; k < 4; ++k) {
    const double upper = a[0].value[k] + fx * (a[1].value[k] - a[0].value[k]);
    const double lower = b[0].value[k] + fx * (b[1].value[k] - b[0].value[k]);
    out.value[k] = upper + fy * (lower - upper);
  }
  return out;
}

double SkyEnergy::weight_before(const Table& table, double x, double y) const {
  x -= table.x0, y -= table.y0;
  const int ix = std::clamp(int(x), 0, table.width - 1),
            iy = std::clamp(int(y), 0, table.height - 1);
  const double fx = x - ix, fy = y - iy;
  const Sum* a = &table.sums[std::size_t(iy) * std::size_t(table.width + 1) + std::size_t(ix)];
  const Sum* b = a + table.width + 1;
  const double upper = a[0].value[3] + fx * (a[1].value[3] - a[0].value[3]);
  const double lower = b[0].value[3] + fx * (b[1].value[3] - b[0].value[3]);
  return upper + fy * (lower - upper);
}

glm::dvec3 SkyEnergy::share(const SkyRect& r) const {
  const Table& t = tables_[std::size_t(r.table)];
  const Sum a = before(t, r.x0, r.y0), b = before(t, r.x1, r.y0), c = before(t, r.x0, r.y1),
            d = before(t, r.x1, r.y1);
  glm::dvec3 out;
  for (int k = 0; k < 3; ++k)
    out[k] = std::max((d.value[k] - c.value[k]) - (b.value[k] - a.value[k]), 0.0);
  return out;
}

double SkyEnergy::weight(const SkyRect& r) const {
  const Table& t = tables_[std::size_t(r.table)];
  const double lower = weight_before(t, r.x1, r.y1) - weight_before(t, r.x0, r.y1);
  return std::max(lower - (weight_before(t, r.x1, r.y0) - weight_before(t, r.x0, r.y0)), 0.0);
}

namespace {

// Where a sum that grows from 0 at `first` to `total` at `last`, linearly within a texel, reaches a
// part of it.
template <typename Sum>
double find(double first, double last, double part, const Sum& sum) {
  double low = first, high = last, at_low = 0, at_high = sum(last);
  const double wanted = part * at_high;
  while (std::ceil(high) - std::floor(low) > 1) {
    const double middle = std::floor(0.5 * (std::floor(low) + std::ceil(high)));
    const double at = sum(middle);
    (at < wanted ? low : high) = middle;
    (at < wanted ? at_low : at_high) = at;
  }
  const double step = at_high - at_low;
  // Without light, in proportion to the angle.
  if (!(step > 0)) return first + part * (last - first);
  return std::clamp(low + (high - low) * (wanted - at_low) / step, first, last);
}

}  // namespace

double SkyEnergy::split_x(const SkyRect& r, double part) const {
  const Table& t = tables_[std::size_t(r.table)];
  const double offset = weight_before(t, r.x0, r.y1) - weight_before(t, r.x0, r.y0);
  return find(r.x0, r.x1, part, [&](double x) {
    return weight_before(t, x, r.y1) - weight_before(t, x, r.y0) - offset;
  });
}

double SkyEnergy::split_y(const SkyRect& r, double part) const {
  const Table& t = tables_[std::size_t(r.table)];
  const double offset = weight_before(t, r.x1, r.y0) - weight_before(t, r.x0, r.y0);
  return find(r.y0, r.y1, part, [&](double y) {
    return weight_before(t, r.x1, y) - weight_before(t, r.x0, y) - offset;
  });
}

// With a and b the position on the face of the unit cube, p = (a, b, 1):
// |∂(p/|p|)/∂a| = √(1 + b²)/(1 + a² + b²).
bool SkyEnergy::is_wide(const SkyRect& r) const {
  const double size = tables_[std::size_t(r.table)].size;
  const double a = (r.x0 + r.x1) / size - 1, b = (r.y0 + r.y1) / size - 1;
  const double along_x = (r.x1 - r.x0) * (r.x1 - r.x0) * (1 + b * b);
  const double along_y = (r.y1 - r.y0) * (r.y1 - r.y0) * (1 + a * a);
  return along_x >= along_y;
}

glm::vec3 SkyEnergy::direction(const SkyRect& r, double x, double y) const {
  const Table& t = tables_[std::size_t(r.table)];
  glm::vec3 d = glm::normalize(face_direction(t.face, float(x / t.size), float(y / t.size)));
  d.z = std::max(d.z, float(kHorizon));
  return glm::normalize(d);
}

}  // namespace fastibl
