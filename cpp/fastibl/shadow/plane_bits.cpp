#include "fastibl/shadow/plane_bits.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kRows = 8;           // worked on at once
constexpr int kBlock = 64;         // spheres that are set up at once
constexpr double kNear = 1 << 14;  // texels; up to here float finds an edge to 1/100 texel

using Counts [[gnu::vector_size(32)]] = std::int32_t;
using WideCounts [[gnu::vector_size(64)]] = std::int64_t;
using Words [[gnu::vector_size(64), gnu::may_alias]] = std::uint64_t;

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
  // The front of a cut sphere ends at a line, of which the place along x is asked for.
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
  std::int32_t row_begin[kBlock], row_last[kBlock], x_begin[kBlock], x_last[kBlock];
};

template <typename T>
FASTIBL_INLINE void set_up(const double* x, const double* y, const double* z, const double* r,
                           int count, const Light<double>& light, double size, Ellipses<T>& out) {
  for (int i = 0; i < count; ++i) {
    const double u = x[i] - z[i] * light.tilt_x, v = y[i] - z[i] * light.tilt_y;
    const double rx = r[i] * light.reach_x, ry = r[i] * light.reach_y;
    out.u[i] = T(u), out.v[i] = T(v);
    out.r2a[i] = T(r[i] * r[i] * light.inverse_a);
    out.x[i] = T(x[i]), out.y[i] = T(y[i]);
    out.front[i] = T(z[i] * light.inverse_dz);
    out.disc2[i] = T((r[i] - z[i]) * (r[i] + z[i]));
    // Clamped before they become integers; empty where the ellipse misses the grid.
    out.row_begin[i] = std::int32_t(std::min(std::max(v - ry, 0.0), size));
    out.row_last[i] = std::int32_t(std::min(std::max(v + ry, -1.0), size - 1));
    out.x_begin[i] = std::int32_t(std::min(std::max(u - rx, 0.0), size));
    out.x_last[i] = std::int32_t(std::min(std::max(u + rx, -1.0), size - 1));
  }
}

// Bits from `begin` on of the words that start at texel 0; begin in [0, 64].
FASTIBL_INLINE void bits_from(const WideCounts& begin, Words& bits) {
  bits = begin > 63 ? Words{} : ~Words{} << reinterpret_cast<Words>(begin);
}

// Eight rows of float or double.
template <typename T>
struct RowsOf {
  using Type [[gnu::vector_size(8 * sizeof(T))]] = T;
};
template <typename T>
using Rows = typename RowsOf<T>::Type;

template <typename V>
FASTIBL_INLINE void limit(V& value, const V& least, const V& most) {
  value = value > least ? value : least;
  value = value < most ? value : most;
}
// √max(x, 0)
template <typename V>
FASTIBL_INLINE void square_root(const V& x, V& result) {
  const V positive = x > 0 ? x : V{};
  for (int k = 0; k < kRows; ++k) result[k] = std::sqrt(positive[k]);
}
template <typename V>
FASTIBL_INLINE void round_up(const V& x, Counts& result) {
  const Counts down = __builtin_convertvector(x, Counts);
  const V rounded = __builtin_convertvector(down, V);
  result = down - __builtin_convertvector(rounded < x, Counts);
}

// ORs the spans [⌈low⌉, ⌈high⌉) of eight rows into the columns.
template <typename V>
FASTIBL_INLINE void add_spans(V low, V high, const V& size, int first_column, int last_column,
                              std::uint64_t* rows, std::ptrdiff_t column_stride) {
  limit(low, V{}, size);
  limit(high, V{}, size);
  Counts begin, end;
  round_up(low, begin);
  round_up(high, end);
  for (int c = first_column; c <= last_column; ++c) {
    const Counts b = begin - 64 * c, e = end - 64 * c;
    const WideCounts from = __builtin_convertvector(b > 0 ? b : Counts{}, WideCounts),
                     to = __builtin_convertvector(e > 0 ? e : Counts{}, WideCounts);
    Words above, beyond;
    bits_from(from, above);
    bits_from(to, beyond);
    auto& words = *reinterpret_cast<Words*>(rows + c * column_stride);
    words |= above & ~beyond;
  }
}

template <bool cut, typename T>
FASTIBL_INLINE void add_ellipse(const Ellipses<T>& e, int i, const Light<T>& light, int size,
                                std::uint64_t* words, std::ptrdiff_t column_stride) {
  using V = Rows<T>;
  const int first_column = e.x_begin[i] / 64, last_column = e.x_last[i] / 64;
  if (e.x_begin[i] > e.x_last[i]) return;
  const V steps = {0, 1, 2, 3, 4, 5, 6, 7}, none = V{} - 1, all = V{} + T(size);
  for (int row = e.row_begin[i] & ~(kRows - 1); row <= e.row_last[i]; row += kRows) {
    const V v = (T(row) - e.v[i]) + steps;
    const V root2 = e.r2a[i] - light.b * v * v, middle = e.u[i] + light.slope * v;
    V half;
    square_root(root2, half);
    V low = middle - half, high = root2 > 0 ? middle + half : none;
    if constexpr (cut) {
      // Only points with q·d = z/dz − u dx − v dy > 0 have the sphere before them; those inside are
      // dark as well. Where the line q·d = 0 crosses the ellipse it is in the disc too, so that the
      // union of both is one span.
      const V line = e.u[i] + (e.front[i] - v * light.dy) / light.dx;
      if (light.dx > 0)
        high = high < line ? high : line;
      else
        low = low > line ? low : line;
      const auto any = low < high;
      low = any ? low : all;
      high = any ? high : none;
      const V y = (T(row) - e.y[i]) + steps, chord2 = e.disc2[i] - y * y;
      V chord;
      square_root(chord2, chord);
      const V left = e.x[i] - chord, right = e.x[i] + chord;
      low = chord2 > 0 && left < low ? left : low;
      high = chord2 > 0 && right > high ? right : high;
    }
    add_spans(low, high, all, first_column, last_column, words + row, column_stride);
  }
}

template <bool cut, typename T>
FASTIBL_INLINE void add_all(const double* x, const double* y, const double* z, const double* r,
                            int count, const Light<double>& setting, const Light<T>& light,
                            int size, std::uint64_t* words, std::ptrdiff_t column_stride,
                            PlaneBits::Box& box) {
  Ellipses<T> ellipses;
  for (int first = 0; first < count; first += kBlock) {
    const int n = std::min(kBlock, count - first);
    set_up(x + first, y + first, z + first, r + first, n, setting, double(size), ellipses);
    std::int32_t low_y = 1 << 20, high_y = -1, low_x = 1 << 20, high_x = -1;
    for (int i = 0; i < n; ++i) {
      low_y = std::min(low_y, ellipses.row_begin[i]),
      high_y = std::max(high_y, ellipses.row_last[i]);
      low_x = std::min(low_x, ellipses.x_begin[i]), high_x = std::max(high_x, ellipses.x_last[i]);
    }
    if (low_y <= high_y && low_x <= high_x) {
      box.first_row = std::min(box.first_row, low_y), box.last_row = std::max(box.last_row, high_y);
      box.first_column = std::min(box.first_column, low_x / 64);
      box.last_column = std::max(box.last_column, high_x / 64);
    }
    for (int i = 0; i < n; ++i) add_ellipse<cut>(ellipses, i, light, size, words, column_stride);
  }
}

FASTIBL_CLONES
void add_whole(const double* x, const double* y, const double* z, const double* r, int count,
               const Light<double>& setting, const Light<float>& light, int size,
               std::uint64_t* words, std::ptrdiff_t column_stride, PlaneBits::Box& box) {
  add_all<false>(x, y, z, r, count, setting, light, size, words, column_stride, box);
}
FASTIBL_CLONES
void add_cut(const double* x, const double* y, const double* z, const double* r, int count,
             const Light<double>& setting, const Light<float>& light, int size,
             std::uint64_t* words, std::ptrdiff_t column_stride, PlaneBits::Box& box) {
  add_all<true>(x, y, z, r, count, setting, light, size, words, column_stride, box);
}
FASTIBL_CLONES
void add_far(const double* x, const double* y, const double* z, const double* r, int count,
             const Light<double>& light, int size, std::uint64_t* words,
             std::ptrdiff_t column_stride, PlaneBits::Box& box) {
  add_all<true>(x, y, z, r, count, light, light, size, words, column_stride, box);
}

}  // namespace

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
}

void PlaneSpheres::add_shadow(glm::vec3 towards_light, PlaneBits& bits) const {
  if (bits.size() == 0) return;
  const glm::dvec3 d = glm::normalize(glm::dvec3(towards_light));
  const Light<double> setting = light_of<double>(d);
  const Light<float> light = light_of<float>(d);
  const auto add = [&](const Arrays& a, const auto& call) {
    if (!a.x.empty()) call(a.x.data(), a.y.data(), a.z.data(), a.r.data(), int(a.x.size()));
  };
  const int n = bits.size();
  std::uint64_t* words = bits.words_[0].row;
  const std::ptrdiff_t stride = bits.padded_rows();
  add(whole_, [&](auto... a) { add_whole(a..., setting, light, n, words, stride, bits.box_); });
  add(cut_, [&](auto... a) { add_cut(a..., setting, light, n, words, stride, bits.box_); });
  add(far_, [&](auto... a) { add_far(a..., setting, n, words, stride, bits.box_); });
  for (int c = 0; c < bits.columns(); ++c)
    for (int y = n; y < bits.padded_rows(); ++y) words[c * stride + y] = 0;
}

}  // namespace fastibl
