#include "fastibl/shadow/sky_energy.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>

#include "fastibl/core/check.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kLeastSize = 16;
constexpr double kHorizon = 1e-3;  // z below which light hardly reaches the plane, and shadows are
                                   // a thousand times as long as what casts them

using Double8 [[gnu::vector_size(64), gnu::aligned(8), gnu::may_alias]] = double;

// Of the texels of a face that are above the horizon.
struct FaceTexels {
  int x0, y0, width, height;
  std::vector<glm::vec3> directions;  // unit length
  std::vector<float> cosines;         // solid angle × z, 0 near the horizon
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
    t = {rects[f][0], rects[f][1], rects[f][2], rects[f][3], {}, {}};
    for (int y = t.y0; y < t.y0 + t.height; ++y)
      for (int x = t.x0; x < t.x0 + t.width; ++x) {
        const glm::vec3 d = glm::normalize(texel_direction(f, x, y, n));
        t.directions.push_back(d);
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
void integrate(const glm::vec3* energy, const glm::vec3* directions, int width, int height,
               const double* inverse, double* sums) {
  const std::size_t stride = 8 * std::size_t(width + 1);
  for (int y = 0; y < height; ++y) {
    Double8 row{};
    const double* above = sums + std::size_t(y) * stride + 8;
    double* out = sums + std::size_t(y + 1) * stride + 8;
    for (int x = 0; x < width; ++x, above += 8, out += 8) {
      const glm::vec3 e = energy[x], d = directions[x];
      const double r = e.x * inverse[0], g = e.y * inverse[1], b = e.z * inverse[2], w = r + g + b;
      row += Double8{r, g, b, w, w * d.x, w * d.y, w * d.z, 0};
      *reinterpret_cast<Double8*>(out) = row + *reinterpret_cast<const Double8*>(above);
    }
    energy += width, directions += width;
  }
}

}  // namespace

SkyEnergy::SkyEnergy(const CubeLevel& radiance) {
  check(radiance.size() > 0, "the radiance map is empty");
  const int n = radiance.size();
  int parts = (kLeastSize + n - 1) / n;
  if (n * parts % 2 == 1) ++parts;
  size_ = n * parts;
  const auto texels = sky_texels(size_);
  std::array<std::vector<glm::vec3>, kSkyFaces> energies;
  for (int f = 0; f < kSkyFaces; ++f) {
    const FaceTexels& t = (*texels)[std::size_t(f)];
    std::vector<glm::vec3>& energy = energies[std::size_t(f)];
    energy.resize(t.cosines.size());
    glm::dvec3 sum(0);
    std::size_t i = 0;
    for (int y = t.y0; y < t.y0 + t.height; ++y) {
      const glm::vec3* row = radiance.face(f) + (y / parts) * radiance.row_stride();
      for (int x = t.x0; x < t.x0 + t.width; ++x, ++i) {
        energy[i] = row[x / parts] * t.cosines[i];
        sum += glm::dvec3(energy[i]);
      }
    }
    irradiance_ += sum;
  }
  double inverse[3];
  for (int c = 0; c < 3; ++c) inverse[c] = irradiance_[c] > 1e-28 ? 1 / irradiance_[c] : 0;
  for (int c = 0; c < 3; ++c)
    if (inverse[c] == 0) irradiance_[c] = 0;
  for (int f = 0; f < kSkyFaces; ++f) {
    const FaceTexels& t = (*texels)[std::size_t(f)];
    Table& table = tables_[std::size_t(f)];
    table = {t.x0, t.y0, t.width, t.height, {}};
    table.sums.resize(std::size_t(t.width + 1) * std::size_t(t.height + 1));
    integrate(energies[std::size_t(f)].data(), t.directions.data(), t.width, t.height, inverse,
              table.sums[0].value);
  }
}

SkyRect SkyEnergy::face(int f) const {
  const Table& t = tables_[std::size_t(f)];
  return {f, double(t.x0), double(t.y0), double(t.x0 + t.width), double(t.y0 + t.height)};
}

// The sums are bilinear within a texel, as if its light were spread evenly over it.
SkyEnergy::Sum SkyEnergy::before(const Table& table, double x, double y) const {
  x -= table.x0, y -= table.y0;
  const int ix = std::clamp(int(x), 0, table.width - 1),
            iy = std::clamp(int(y), 0, table.height - 1);
  const double fx = x - ix, fy = y - iy;
  const Sum* a = &table.sums[std::size_t(iy) * std::size_t(table.width + 1) + std::size_t(ix)];
  const Sum* b = a + table.width + 1;
  Sum out;
  for (int k = 0; k < 8; ++k) {
    const double upper = a[0].value[k] + fx * (a[1].value[k] - a[0].value[k]);
    const double lower = b[0].value[k] + fx * (b[1].value[k] - b[0].value[k]);
    out.value[k] = upper + fy * (lower - upper);
  }
  return out;
}

SkyEnergy::Sum SkyEnergy::sum(const SkyRect& r) const {
  const Table& table = tables_[std::size_t(r.face)];
  const Sum a = before(table, r.x0, r.y0), b = before(table, r.x1, r.y0),
            c = before(table, r.x0, r.y1), d = before(table, r.x1, r.y1);
  Sum out;
  for (int k = 0; k < 8; ++k) out.value[k] = (d.value[k] - c.value[k]) - (b.value[k] - a.value[k]);
  return out;
}

glm::dvec3 SkyEnergy::share(const SkyRect& rect) const {
  const Sum s = sum(rect);
  return glm::max(glm::dvec3(s.value[0], s.value[1], s.value[2]), 0.0);
}

double SkyEnergy::weight(const SkyRect& rect) const { return std::max(sum(rect).value[3], 0.0); }

glm::vec3 SkyEnergy::direction(const SkyRect& r) const {
  const float scale = 1 / float(size_);
  const glm::vec3 middle = glm::normalize(face_direction(r.face, float(0.5 * (r.x0 + r.x1)) * scale,
                                                         float(0.5 * (r.y0 + r.y1)) * scale));
  // Within a texel the light has no place of its own.
  if (r.x1 - r.x0 <= 1 || r.y1 - r.y0 <= 1) return middle;
  const Sum s = sum(r);
  const glm::dvec3 mean(s.value[4], s.value[5], s.value[6]);
  // Of differences of sums that are far larger nothing is left: as if it were dark.
  if (!(s.value[3] > 1e-12) || !(glm::length(mean) > 0.5 * s.value[3])) return middle;
  return glm::vec3(glm::normalize(mean));
}

double SkyEnergy::weight_before(const Table& table, int x, double y) const {
  const double local = y - table.y0;
  const int iy = std::clamp(int(local), 0, table.height - 1);
  const Sum* a =
      &table.sums[std::size_t(iy) * std::size_t(table.width + 1) + std::size_t(x - table.x0)];
  return a[0].value[3] + (local - iy) * (a[table.width + 1].value[3] - a[0].value[3]);
}

double SkyEnergy::split_x(const SkyRect& rect, double weight) const {
  const Table& table = tables_[std::size_t(rect.face)];
  // The weight of the columns between x0 and a whole x.
  const double offset =
      before(table, rect.x0, rect.y1).value[3] - before(table, rect.x0, rect.y0).value[3];
  const auto columns = [&](int x) {
    return weight_before(table, x, rect.y1) - weight_before(table, x, rect.y0) - offset;
  };
  int low = int(std::floor(rect.x0)), high = int(std::ceil(rect.x1));
  double at_low = columns(low), at_high = columns(high);
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    const double at = columns(middle);
    (at < weight ? low : high) = middle;
    (at < weight ? at_low : at_high) = at;
  }
  const double step = at_high - at_low;
  const double x = step > 0 ? low + (weight - at_low) / step : 0.5 * (low + high);
  return std::clamp(x, rect.x0, rect.x1);
}

double SkyEnergy::split_y(const SkyRect& rect, double weight) const {
  SkyRect upper = rect;
  int low = int(std::floor(rect.y0)), high = int(std::ceil(rect.y1));
  const auto rows = [&](int y) {
    upper.y1 = y;
    return sum(upper).value[3];
  };
  double at_low = rows(low), at_high = rows(high);
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    const double at = rows(middle);
    (at < weight ? low : high) = middle;
    (at < weight ? at_low : at_high) = at;
  }
  const double step = at_high - at_low;
  const double y = step > 0 ? low + (weight - at_low) / step : 0.5 * (low + high);
  return std::clamp(y, rect.y0, rect.y1);
}

}  // namespace fastibl
