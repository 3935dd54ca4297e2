#include "fastibl/shadow/plane_bits.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/wide.h"
#include "fastibl/scene/shared_formulas.h"

#ifdef FASTIBL_WITH_AVX2
#include <immintrin.h>
#ifndef __clang__  // GCC 12 warns of its own header's undefined registers
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#endif

namespace fastibl {
namespace {

constexpr double kNear = 1 << 14;  // texels; up to here float finds an edge to 1/100 texel
constexpr int kBlock = 64;         // spheres that are set up at once: a bit each
constexpr int kPadding = 16;       // spheres of an array come in so many
constexpr int kMostSize = 8192;    // texels along an edge
constexpr int kMostGroups = kMostSize / 8, kMostColumns = kMostSize / 64;

// A ray from the point p towards the light d passes the centre c at the distance of q = c − p from
// the line, |q|² − (q·d)². With u = (p − c).xy + c.z d.xy/d.z that is
//   u² (1 − dx²) + v² (1 − dy²) − 2 u v dx dy,
// an ellipse around the centre's own shadow, and for a row v with a = 1 − dx² = dy² + dz²
//   u = dx dy/a v ± √(r²/a − dz²/a² v²).
template <typename T>
struct Light {
  T tilt_x, tilt_y;       // shift of a shadow per height
  T reach_x, reach_y;     // half width and height of the ellipse of a unit sphere
  T slope, inverse_a, b;  // dx dy/a, 1/a, dz²/a²
  T dx, dy, inverse_dz;
};

template <typename T>
Light<T> light_of(glm::dvec3 d) {
  const double a = d.y * d.y + d.z * d.z, c = d.x * d.x + d.z * d.z;
  // The front of a cut sphere ends at a line, whose place along x is asked for.
  const double dx = std::fabs(d.x) < 1e-9 ? 1e-9 : d.x;
  return {T(d.x / d.z),     T(d.y / d.z), T(std::sqrt(c) / d.z),  T(std::sqrt(a) / d.z),
          T(d.x * d.y / a), T(1 / a),     T(d.z * d.z / (a * a)), T(dx),
          T(d.y),           T(1 / d.z)};
}

// What the rows need of a sphere.
template <typename T>
struct Ellipses {
  T u[kBlock], v[kBlock];  // centre of the ellipse
  T r2a[kBlock];           // r²/a
  T x[kBlock], y[kBlock];  // centre of the sphere
  T front[kBlock];         // z/dz
  T disc2[kBlock];         // r² − z²
  // Of the groups of eight rows and the columns that it touches. None: first > last.
  std::int32_t first_group[kBlock], last_group[kBlock], first_column[kBlock], last_column[kBlock];
};

// Spheres, their count a multiple of kPadding.
struct Spheres {
  const double *x, *y, *z, *r;
  int count;
};

// Words that the bits go to, and within which groups and columns they lie.
struct Target {
  int size;
  std::uint64_t* words;
  std::ptrdiff_t column_stride;
  std::int32_t first_group, last_group, first_column, last_column;
};

#define FASTIBL_KERNEL "fastibl/shadow/plane_bits_kernel.inl"
#define FASTIBL_KERNEL_AVX512
#include "fastibl/core/kernel.inl"
FASTIBL_PICK_AVX512(add_whole);
FASTIBL_PICK_AVX512(add_cut);
FASTIBL_PICK_AVX512(add_far);

}  // namespace

void PlaneGrid::points(int x, int y, std::span<glm::vec2> out) const {
  const float n = float(size);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = centre +
             extent * glm::vec2(shared::plane_offset(x + int(i), n), shared::plane_offset(y, n));
}

void PlaneBits::set_span(int row, int begin, int end) {
  for (int c = begin / 64; 64 * c < end; ++c) {
    const int from = std::max(begin - 64 * c, 0), to = std::min(end - 64 * c, 64);
    if (from >= to) continue;
    words_[std::size_t(c) * std::size_t(groups_)].row[row] |=
        (~std::uint64_t{0} >> (64 - (to - from))) << from;
    box_.first_column = std::min(box_.first_column, c);
    box_.last_column = std::max(box_.last_column, c);
  }
  box_.first_row = std::min(box_.first_row, row);
  box_.last_row = std::max(box_.last_row, row);
}

void PlaneBits::clear() {
  if (box_.last_row >= 0)
    for (int c = box_.first_column; c <= box_.last_column; ++c) {
      Group* column = &words_[std::size_t(c) * std::size_t(groups_)];
      std::fill(column + box_.first_row / 8, column + box_.last_row / 8 + 1, Group{});
    }
  box_ = {};
}

PlaneSpheres::PlaneSpheres(const SphereSet& spheres, const PlaneGrid& grid) {
  const double scale = 1 / grid.texel();
  for (const glm::vec4& s : spheres) {
    if (!is_sphere(s)) {
      ++ignored_;
      continue;
    }
    if (double(s.z) + double(s.w) <= 0) continue;
    const glm::dvec2 p = grid.texels({s.x, s.y});
    const double z = s.z * scale, r = s.w * scale;
    const bool near = std::max({std::fabs(p.x), std::fabs(p.y), std::fabs(z), r}) < kNear;
    Arrays& arrays = !near ? far_ : z < r ? cut_ : whole_;
    arrays.x.push_back(p.x), arrays.y.push_back(p.y), arrays.z.push_back(z), arrays.r.push_back(r);
    ++size_;
  }
  for (Arrays* a : {&whole_, &cut_, &far_})  // pads with what touches no grid
    for (; a->x.size() % kPadding != 0; a->x.push_back(-1e6))
      a->y.push_back(-1e6), a->z.push_back(0), a->r.push_back(0);
}

void PlaneSpheres::add_shadow(glm::vec3 towards_light, PlaneBits& bits) const {
  if (bits.size() == 0) return;
  check(bits.size() <= kMostSize, "a plane's bits must be at most ", kMostSize,
        " texels wide, got ", bits.size());
  const glm::dvec3 d = glm::normalize(glm::dvec3(towards_light));
  const Light<double> setting = light_of<double>(d);
  const Light<float> light = light_of<float>(d);
  const int n = bits.size();
  Target target{.size = n,
                .words = bits.words_[0].row,
                .column_stride = bits.padded_rows(),
                .first_group = kMostGroups,
                .last_group = -1,
                .first_column = kMostColumns,
                .last_column = -1};
  const auto all = [](const Arrays& a) {
    return Spheres{a.x.data(), a.y.data(), a.z.data(), a.r.data(), int(a.x.size())};
  };
  if (!whole_.x.empty()) add_whole(all(whole_), setting, light, target);
  if (!cut_.x.empty()) add_cut(all(cut_), setting, light, target);
  if (!far_.x.empty()) add_far(all(far_), setting, target);
  if (target.last_group < 0) return;
  PlaneBits::Box& box = bits.box_;
  box.first_row = std::min(box.first_row, 8 * target.first_group);
  box.last_row = std::max(box.last_row, std::min(8 * target.last_group + 7, n - 1));
  box.first_column = std::min(box.first_column, target.first_column);
  box.last_column = std::max(box.last_column, target.last_column);
  // Clears the last group's rows beyond the grid.
  for (int c = target.first_column; c <= target.last_column; ++c)
    for (int y = n; y < bits.padded_rows(); ++y) target.words[c * target.column_stride + y] = 0;
}

}  // namespace fastibl
