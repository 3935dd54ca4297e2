// Triangles on their way to bits of the plane; see core/wide.h for how it is compiled.

#include "fastibl/core/wide.inl"

// Positions on the grid, where centres of texels are whole numbers: pairs of x and y.
FASTIBL_TARGET void project(const float* x, const float* y, const float* z, int count,
                            const float* slope, const float* shift, float scale, float* places) {
  const float slope_x = slope[0], slope_y = slope[1], shift_x = shift[0], shift_y = shift[1];
  for (int i = 0; i < count; ++i) {
    const float u = (x[i] - z[i] * slope_x) * scale + shift_x,
                v = (y[i] - z[i] * slope_y) * scale + shift_y;
    // In this order a NaN becomes a number too.
    places[2 * i] = std::min(kFar, std::max(-kFar, u));
    places[2 * i + 1] = std::min(kFar, std::max(-kFar, v));
  }
}

// The same for a near light, 1 / inverse_height above the plane; what is above `top` counts as at
// it.
FASTIBL_TARGET void project_near(const float* x, const float* y, const float* z, int count,
                                 const float* slope, const float* shift, float scale, float top,
                                 float inverse_height, float* places) {
  const float slope_x = slope[0], slope_y = slope[1], shift_x = shift[0], shift_y = shift[1];
  for (int i = 0; i < count; ++i) {
    const float h = std::min(z[i], top), fall = 1 - h * inverse_height;
    const float u = scale * ((x[i] - h * slope_x) / fall) + shift_x,
                v = scale * ((y[i] - h * slope_y) / fall) + shift_y;
    places[2 * i] = std::min(kFar, std::max(-kFar, u));
    places[2 * i + 1] = std::min(kFar, std::max(-kFar, v));
  }
}

#ifdef FASTIBL_IN_AVX2
// The first corners of four triangles, or the second, or the third.
FASTIBL_KERNEL_INLINE __m256 corners(const float* places, std::int32_t a, std::int32_t b,
                                     std::int32_t c, std::int32_t d) {
  const auto two = [places](std::int32_t i, std::int32_t j) FASTIBL_TARGET {
    const auto* p = (const double*)places;
    return _mm_loadh_pd(_mm_load_sd(p + i), p + j);
  };
  return _mm256_castpd_ps(_mm256_set_m128d(two(c, d), two(a, b)));
}
#endif

// Where a position lies among the centres of texels: 2k − 1 between k − 1 and k, 2k at k; for x in
// the lower half, for y in the upper. All positions before the first are one place, and so are all
// beyond the last.
FASTIBL_TARGET void find_cells(const float* places, int count, float last, std::int32_t* cells) {
  const float most = last + 0.5f;
  for (int i = 0; i < count; ++i) {
    const float x = std::min(most, std::max(-0.5f, places[2 * i])),
                y = std::min(most, std::max(-0.5f, places[2 * i + 1]));
    const int u = int(std::floor(x)) + int(std::ceil(x)),
              v = int(std::floor(y)) + int(std::ceil(y));
    cells[i] = (u & 0xffff) | v << 16;
  }
}

// Finds the triangles whose box holds the centre of a texel, in order. Those of at most kLow rows
// go to `low`, taller ones to `tall`; both have room for kWide more than all.
FASTIBL_TARGET void find_met(const std::int32_t* a, const std::int32_t* b, const std::int32_t* c,
                             int count, const std::int32_t* cells, std::int32_t* low,
                             std::int32_t* tall, int* low_count, int* tall_count) {
  int lows = 0, talls = 0, i = 0;
#ifdef FASTIBL_IN_AVX2
  // The lanes of a mask, and then others.
  alignas(64) static constexpr auto lanes = [] {
    std::array<std::array<std::int32_t, kWide>, 1 << kWide> all{};
    for (unsigned mask = 0; mask < all.size(); ++mask)
      for (int k = 0, n = 0; k < kWide; ++k)
        if (mask >> k & 1) all[mask][std::size_t(n++)] = k;
    return all;
  }();
  const auto append = [&](unsigned mask, std::int32_t* list, int& number) FASTIBL_TARGET {
    const __m256i chosen = _mm256_load_si256((const __m256i*)lanes[mask].data());
    _mm256_storeu_si256((__m256i*)(list + number), _mm256_add_epi32(chosen, _mm256_set1_epi32(i)));
    number += __builtin_popcount(mask);
  };
  const __m256i one = _mm256_set1_epi16(1), none = _mm256_setzero_si256(),
                rows = _mm256_set1_epi32(kLow - 1);
  const auto cells_of = [&](const std::int32_t* corner) FASTIBL_TARGET {
    return _mm256_i32gather_epi32(cells, _mm256_loadu_si256((const __m256i*)(corner + i)), 4);
  };
  for (; i + kWide <= count; i += kWide) {
    const __m256i pa = cells_of(a), pb = cells_of(b), pc = cells_of(c);
    const __m256i least = _mm256_min_epi16(_mm256_min_epi16(pa, pb), pc),
                  most = _mm256_max_epi16(_mm256_max_epi16(pa, pb), pc);
    const __m256i first = _mm256_srai_epi16(_mm256_add_epi16(least, one), 1),
                  final = _mm256_srai_epi16(most, 1);
    const __m256i met = _mm256_cmpeq_epi32(_mm256_cmpgt_epi16(first, final), none);
    const auto bits = unsigned(_mm256_movemask_ps(_mm256_castsi256_ps(met)));
    if (bits == 0) continue;
    const __m256i high =
        _mm256_cmpgt_epi32(_mm256_srai_epi32(_mm256_sub_epi16(final, first), 16), rows);
    const auto many = unsigned(_mm256_movemask_ps(_mm256_castsi256_ps(high)));
    append(bits & ~many, low, lows);
    if (bits & many) append(bits & many, tall, talls);
  }
#endif
  for (; i < count; ++i) {
    int first[2], end[2];
    for (int k = 0; k < 2; ++k) {
      const auto at = [&](std::int32_t corner) { return std::int16_t(cells[corner] >> 16 * k); };
      const auto [least, most] = std::minmax({at(a[i]), at(b[i]), at(c[i])});
      first[k] = (least + 1) >> 1, end[k] = most >> 1;
    }
    const bool met = first[0] <= end[0] && first[1] <= end[1], high = end[1] - first[1] >= kLow;
    low[lows] = i, tall[talls] = i;
    lows += met && !high, talls += met && high;
  }
  *low_count = lows, *tall_count = talls;
}

FASTIBL_KERNEL_INLINE WideInt whole(Wide a) { return __builtin_convertvector(a, WideInt); }
FASTIBL_KERNEL_INLINE Wide numbers(WideInt a) { return __builtin_convertvector(a, Wide); }

// The corners of eight triangles: those at `corner`.
FASTIBL_KERNEL_INLINE void load_places(const float* places, const std::int32_t* corner,
                                       const std::int32_t* triangles, Wide& x, Wide& y) {
#ifdef FASTIBL_IN_AVX2
  const std::int32_t* t = triangles;
  const __m256 first = corners(places, corner[t[0]], corner[t[1]], corner[t[4]], corner[t[5]]),
               second = corners(places, corner[t[2]], corner[t[3]], corner[t[6]], corner[t[7]]);
  x = _mm256_shuffle_ps(first, second, 0x88), y = _mm256_shuffle_ps(first, second, 0xdd);
#else
  for (int l = 0; l < kWide; ++l) {
    const float* p = places + 2 * corner[triangles[l]];
    x[l] = p[0], y[l] = p[1];
  }
#endif
}

// Draws triangles of at most kLow rows, which most are, by the arithmetic of draw_triangle and
// without a branch that depends on a triangle.
FASTIBL_TARGET void draw_low(const std::int32_t* chosen, int count, const std::int32_t* a,
                             const std::int32_t* b, const std::int32_t* c, const float* places,
                             float last_texel, std::ptrdiff_t stride, std::uint64_t* words) {
  const Wide none = repeat(0), one = repeat(1), last = repeat(last_texel);
  for (int begin = 0; begin < count; begin += kWide) {
    Wide x[3], y[3], slope[3], low[3], high[3];
    std::int32_t triangles[kWide];
    for (int l = 0; l < kWide; ++l) triangles[l] = chosen[std::min(begin + l, count - 1)];
    load_places(places, a, triangles, x[0], y[0]);
    load_places(places, b, triangles, x[1], y[1]);
    load_places(places, c, triangles, x[2], y[2]);
    for (int k = 0; k < 3; ++k) {
      const int from = k == 2 ? 0 : k, to = k == 0 ? 1 : 2;
      const Wide rise = y[to] - y[from];
      const WideInt flat = rise == none;
      slope[k] = flat ? none : (x[to] - x[from]) / (flat ? one : rise);
      low[k] = flat ? one : smaller(y[from], y[to]);
      high[k] = flat ? none : larger(y[from], y[to]);
    }
    const Wide y0 = larger(smaller(smaller(y[0], y[1]), y[2]), none),
               y1 = smaller(larger(larger(y[0], y[1]), y[2]), last);
    const Wide floor0 = numbers(whole(y0)), last_row = numbers(whole(y1));
    for (Wide at = floor0 + (floor0 < y0 ? one : none);; at += one) {
      const WideInt inside = at <= last_row;
      if (set_bits(inside) == 0) break;
      Wide left = repeat(kFar), right = repeat(-kFar);
      for (int k = 0; k < 3; ++k) {
        const int from = k == 2 ? 0 : k;
        const Wide cross = x[from] + (at - y[from]) * slope[k];
        const WideInt met = (at >= low[k]) & (at <= high[k]);
        left = met ? smaller(cross, left) : left;
        right = met ? larger(cross, right) : right;
      }
      left = larger(left, none), right = smaller(right, last);
      const WideInt some = (left <= right) & inside;
      left = some ? left : one, right = some ? right : none;
      const WideInt floor_left = whole(left);
      const WideInt start = floor_left - (numbers(floor_left) < left), end = whole(right),
                    row = whole(at);
      for (unsigned covered = set_bits(start <= end); covered != 0; covered &= covered - 1) {
        const int l = __builtin_ctz(covered), s = start[l], e = end[l];
        if ((e >> 6) > (s >> 6))
          set_span(words + row[l], stride, s, e);
        else
          words[(e >> 6) * stride + row[l]] |=
              (~std::uint64_t{0} << (s & 63)) & (~std::uint64_t{0} >> (63 - (e & 63)));
      }
    }
  }
}
