// The bits of ellipses; see core/wide.h for how it is compiled. The words of a column are worked on
// in groups of eight rows. All ellipses that touch a group are drawn before its words are stored,
// so that none waits for those before it.

#include "fastibl/core/wide.inl"

typedef std::int32_t Counts __attribute__((vector_size(32)));
typedef float Floats __attribute__((vector_size(32)));
typedef double Doubles __attribute__((vector_size(64)));

// √max(x, 0)
template <typename V>
FASTIBL_KERNEL_INLINE V square_root(V x) {
  const V positive = x > 0 ? x : V{};
  V result;
  for (int k = 0; k < 8; ++k) result[k] = std::sqrt(positive[k]);
  return result;
}

// ⌈x⌉ within [0, most].
template <typename V>
FASTIBL_KERNEL_INLINE Counts round_up(V x, V most) {
  x = x > 0 ? x : V{};
  x = x < most ? x : most;
  const Counts down = __builtin_convertvector(x, Counts);
  return down - __builtin_convertvector(__builtin_convertvector(down, V) < x, Counts);
}

#if defined(FASTIBL_IN_AVX2) || defined(FASTIBL_IN_AVX512)
FASTIBL_KERNEL_INLINE Floats square_root(Floats x) {
  return _mm256_sqrt_ps(_mm256_max_ps(x, _mm256_setzero_ps()));
}
#endif

// Eight words of a group of rows. add(begin, end) sets the bits [begin, end); those below 0 and
// above 63 do not exist.
#if defined(FASTIBL_IN_AVX512)
struct Words {
  __m512i row;
  FASTIBL_KERNEL_INLINE explicit Words(const std::uint64_t* p) : row(_mm512_load_si512(p)) {}
  FASTIBL_KERNEL_INLINE void store(std::uint64_t* p) const { _mm512_store_si512(p, row); }
  FASTIBL_KERNEL_INLINE void add(__m512i begin_and_end) {  // eight of each
    const __m512i at = _mm512_max_epi32(begin_and_end, _mm512_setzero_si512());
    const __m512i all = _mm512_set1_epi64(-1);  // shifted by more than 63 it is 0
    const __m512i from = _mm512_sllv_epi64(all, _mm512_cvtepu32_epi64(_mm512_castsi512_si256(at)));
    const __m512i to =
        _mm512_sllv_epi64(all, _mm512_cvtepu32_epi64(_mm512_extracti64x4_epi64(at, 1)));
    row = _mm512_or_si512(row, _mm512_andnot_si512(to, from));
  }
  FASTIBL_KERNEL_INLINE void add(Counts begin, Counts end) {
    add(_mm512_inserti64x4(_mm512_castsi256_si512((__m256i)begin), (__m256i)end, 1));
  }
};
#elif defined(FASTIBL_IN_AVX2)
FASTIBL_KERNEL_INLINE Counts round_up(Floats x, Floats most) {
  const __m256 within = _mm256_min_ps(_mm256_max_ps(x, _mm256_setzero_ps()), most);
  return (Counts)_mm256_cvttps_epi32(_mm256_ceil_ps(within));
}
struct Words {
  __m256i row[2];  // four of each
  FASTIBL_KERNEL_INLINE explicit Words(const std::uint64_t* p)
      : row{_mm256_load_si256((const __m256i*)p), _mm256_load_si256((const __m256i*)p + 1)} {}
  FASTIBL_KERNEL_INLINE void store(std::uint64_t* p) const {
    _mm256_store_si256((__m256i*)p, row[0]), _mm256_store_si256((__m256i*)p + 1, row[1]);
  }
  FASTIBL_KERNEL_INLINE void add(__m256i& words, __m128i begin, __m128i end) {
    const __m256i all = _mm256_set1_epi64x(-1);  // shifted by more than 63 it is 0
    const __m256i from = _mm256_sllv_epi64(all, _mm256_cvtepu32_epi64(begin)),
                  to = _mm256_sllv_epi64(all, _mm256_cvtepu32_epi64(end));
    words = _mm256_or_si256(words, _mm256_andnot_si256(to, from));
  }
  FASTIBL_KERNEL_INLINE void add(Counts begin, Counts end) {
    const __m256i none = _mm256_setzero_si256(), b = _mm256_max_epi32((__m256i)begin, none),
                  e = _mm256_max_epi32((__m256i)end, none);
    add(row[0], _mm256_castsi256_si128(b), _mm256_castsi256_si128(e));
    add(row[1], _mm256_extracti128_si256(b, 1), _mm256_extracti128_si256(e, 1));
  }
};
#else
struct Words {
  std::uint64_t row[8];
  explicit Words(const std::uint64_t* p) { std::memcpy(row, p, sizeof row); }
  void store(std::uint64_t* p) const { std::memcpy(p, row, sizeof row); }
  void add(const Counts& begin, const Counts& end) {
    const auto from = [](std::int32_t at) {
      return at > 63 ? 0 : ~std::uint64_t{0} << std::max(at, 0);
    };
    for (int k = 0; k < 8; ++k) row[k] |= from(begin[k]) & ~from(end[k]);
  }
};
#endif

// Adds the texels [⌈low⌉, ⌈high⌉) below `size` to words that start at texel `base`.
template <typename V>
FASTIBL_KERNEL_INLINE void add_spans(V low, V high, V size, int base, Words& words) {
  words.add(round_up(low, size) - base, round_up(high, size) - base);
}
#ifdef FASTIBL_IN_AVX512
FASTIBL_KERNEL_INLINE void add_spans(Floats low, Floats high, Floats size, int base, Words& words) {
  const __m512 ends = _mm512_min_ps(_mm512_insertf32x8(_mm512_castps256_ps512(low), high, 1),
                                    _mm512_broadcast_f32x8(size));
  const __m512i up = _mm512_cvt_roundps_epi32(ends, _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC);
  words.add(_mm512_sub_epi32(up, _mm512_set1_epi32(base)));
}
#endif

// Adds what eight rows hold of an ellipse to their words, which start at texel `base`.
template <bool cut, typename V, typename T>
FASTIBL_KERNEL_INLINE void add_ellipse(const Ellipses<T>& e, std::size_t i, const Light<T>& light,
                                       V rows, V size, int base, Words& words) {
  const V v = rows - e.v[i], none = V{} - 1;
  const V root2 = e.r2a[i] - light.b * v * v, middle = e.u[i] + light.slope * v;
  const V half = square_root(root2);
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
    low = any ? low : size;
    high = any ? high : none;
    const V y = rows - e.y[i], chord2 = e.disc2[i] - y * y;
    const V chord = square_root(chord2);
    const V left = e.x[i] - chord, right = e.x[i] + chord;
    low = chord2 > 0 && left < low ? left : low;
    high = chord2 > 0 && right > high ? right : high;
  }
  add_spans(low, high, size, base, words);
}

// Sets up at most kBlock spheres, a multiple of kPadding.
template <typename T>
FASTIBL_KERNEL_INLINE void set_up(const Spheres& s, int first, int count,
                                  const Light<double>& light, int size, Ellipses<T>& out) {
  const double *x = s.x + first, *y = s.y + first, *z = s.z + first, *r = s.r + first;
  const double most = double(size);
  for (int i = 0; i < count / kPadding * kPadding; ++i) {
    const double u = x[i] - z[i] * light.tilt_x, v = y[i] - z[i] * light.tilt_y;
    const double rx = r[i] * light.reach_x, ry = r[i] * light.reach_y;
    out.u[i] = T(u), out.v[i] = T(v);
    out.r2a[i] = T(r[i] * r[i] * light.inverse_a);
    out.x[i] = T(x[i]), out.y[i] = T(y[i]);
    out.front[i] = T(z[i] * light.inverse_dz);
    out.disc2[i] = T((r[i] - z[i]) * (r[i] + z[i]));
    // Clamped before they become integers; empty where the ellipse misses the grid.
    const std::int32_t top = std::int32_t(std::min(std::max(v - ry, 0.0), most)),
                       bottom = std::int32_t(std::min(std::max(v + ry, -1.0), most - 1)),
                       left = std::int32_t(std::min(std::max(u - rx, 0.0), most)),
                       right = std::int32_t(std::min(std::max(u + rx, -1.0), most - 1));
    const bool any = top <= bottom && left <= right;
    out.first_group[i] = any ? top / 8 : kMostGroups, out.last_group[i] = any ? bottom / 8 : -1;
    out.first_column[i] = any ? left / 64 : kMostColumns;
    out.last_column[i] = any ? right / 64 : -1;
  }
}

// Which of up to 64 spheres touch each of several lines: bit i of line k. A sphere's bit changes
// only where the sphere begins and behind where it ends, so that its extent does not matter to the
// cost.
template <int most>
struct Touched {
  std::uint64_t line[most + 1];
  int first = most, last = -1;
};
template <int most>
FASTIBL_KERNEL_INLINE void find_touched(const std::int32_t* begin, const std::int32_t* end,
                                        int count, Touched<most>& out) {
  std::int32_t first = most, last = -1;
  for (int i = 0; i < count; ++i) first = std::min(first, begin[i]), last = std::max(last, end[i]);
  out.first = first, out.last = last;
  if (first > last) return;
  for (int k = first; k <= last + 1; ++k) out.line[k] = 0;
  for (int i = 0; i < count; ++i) {
    if (begin[i] > end[i]) continue;
    const std::uint64_t bit = std::uint64_t{1} << i;
    out.line[begin[i]] ^= bit, out.line[end[i] + 1] ^= bit;
  }
  for (int k = first + 1; k <= last; ++k) out.line[k] ^= out.line[k - 1];
}

template <bool cut, typename V, typename T>
FASTIBL_KERNEL_INLINE void add_all(const Spheres& spheres, const Light<double>& setting,
                                   const Light<T>& light, Target& target) {
  Ellipses<T> ellipses;
  Touched<kMostGroups> groups;
  Touched<kMostColumns> columns;
  const V size = V{} + T(target.size), steps = V{0, 1, 2, 3, 4, 5, 6, 7};
  for (int begin = 0; begin < spheres.count; begin += kBlock) {
    const int count = std::min(kBlock, spheres.count - begin);
    set_up(spheres, begin, count, setting, target.size, ellipses);
    find_touched(ellipses.first_group, ellipses.last_group, count, groups);
    if (groups.first > groups.last) continue;
    find_touched(ellipses.first_column, ellipses.last_column, count, columns);
    target.first_group = std::min(target.first_group, groups.first);
    target.last_group = std::max(target.last_group, groups.last);
    target.first_column = std::min(target.first_column, columns.first);
    target.last_column = std::max(target.last_column, columns.last);
    for (int c = columns.first; c <= columns.last; ++c)
      for (int g = groups.first; g <= groups.last; ++g) {
        std::uint64_t left = groups.line[g] & columns.line[c];
        if (left == 0) continue;
        std::uint64_t* place = target.words + c * target.column_stride + 8 * g;
        const V rows = steps + T(8 * g);
        Words words(place);
        for (; left != 0; left &= left - 1)
          add_ellipse<cut>(ellipses, std::size_t(std::countr_zero(left)), light, rows, size, 64 * c,
                           words);
        words.store(place);
      }
  }
}

FASTIBL_TARGET void add_whole(const Spheres& spheres, const Light<double>& setting,
                              const Light<float>& light, Target& target) {
  add_all<false, Floats>(spheres, setting, light, target);
}
FASTIBL_TARGET void add_cut(const Spheres& spheres, const Light<double>& setting,
                            const Light<float>& light, Target& target) {
  add_all<true, Floats>(spheres, setting, light, target);
}
// Spheres too large or too far for float: the cost of treating them as cut no longer counts.
FASTIBL_TARGET void add_far(const Spheres& spheres, const Light<double>& light, Target& target) {
  add_all<true, Doubles>(spheres, light, light, target);
}
