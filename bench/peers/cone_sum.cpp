// The paper's shadow as fast as it can be made per pixel: every pixel of the plane adds up, over
// all spheres, what each holds back: one cone, one light fetch. Sixteen pixels at once (AVX-512),
// or eight (AVX2).
//
// What makes it fast, beside the registers:
// - A fetch is one gather of 32 bits: floats of 11, 11 and 10 bits, of which two are read with
// their neighbours' bits
//   below their last.
// - Its address needs one division: the upper half of the octahedron, unfolded to a square, whose
// axes are x + y and
//   x - y; so all is done in these. A level is 2^k texels wide and begins at 4^k, so that row and
//   column lead to it.
// - k is that of the cone's solid angle, to the nearest: 1 - cos(alpha) = sin^2(alpha) / 2 but for
// the widest, and the
//   logarithm is the exponent of a float.
// - Reciprocals are the machine's, within 2^-11.
#include <immintrin.h>

#include <cstdint>

#if defined(__AVX512F__) && defined(__AVX512DQ__)
constexpr int kWidth = 16;
using Floats = __m512;
using Ints = __m512i;
using Mask = __mmask16;
inline Floats load(const float* p) { return _mm512_loadu_ps(p); }
inline void store(float* p, Floats v) { _mm512_storeu_ps(p, v); }
inline Floats all(float v) { return _mm512_set1_ps(v); }
inline Ints all(std::int32_t v) { return _mm512_set1_epi32(v); }
inline Floats fma(Floats a, Floats b, Floats c) { return _mm512_fmadd_ps(a, b, c); }
inline Floats largest_absolute(Floats a, Floats b) { return _mm512_range_ps(a, b, 0b1011); }
inline Floats root_inverse(Floats v) { return _mm512_rsqrt14_ps(v); }
inline Floats inverse(Floats v) { return _mm512_rcp14_ps(v); }
inline Ints bits(Floats v) { return _mm512_castps_si512(v); }
inline Floats floats(Ints v) { return _mm512_castsi512_ps(v); }
inline Ints truncate(Floats v) { return _mm512_cvttps_epi32(v); }
template <int N>
inline Ints right(Ints v) {
  return _mm512_srli_epi32(v, N);
}
template <int N>
inline Ints left(Ints v) {
  return _mm512_slli_epi32(v, N);
}
inline Ints left(Ints v, Ints by) { return _mm512_sllv_epi32(v, by); }
inline Ints add(Ints a, Ints b) { return _mm512_add_epi32(a, b); }
inline Ints subtract(Ints a, Ints b) { return _mm512_sub_epi32(a, b); }
inline Ints greatest(Ints a, Ints b) { return _mm512_max_epi32(a, b); }
inline Ints gather(const std::uint32_t* p, Ints at) { return _mm512_i32gather_epi32(at, p, 4); }
inline Mask at_least(Floats a, Floats b) { return _mm512_cmp_ps_mask(a, b, _CMP_GE_OQ); }
inline Floats zero_where(Mask m, Floats v) { return _mm512_mask_mov_ps(v, m, _mm512_setzero_ps()); }
inline Floats greatest(Floats a, Floats b) { return _mm512_max_ps(a, b); }
#elif defined(__AVX2__) && defined(__FMA__)
constexpr int kWidth = 8;
using Floats = __m256;
using Ints = __m256i;
using Mask = __m256;
inline Floats load(const float* p) { return _mm256_loadu_ps(p); }
inline void store(float* p, Floats v) { _mm256_storeu_ps(p, v); }
inline Floats all(float v) { return _mm256_set1_ps(v); }
inline Ints all(std::int32_t v) { return _mm256_set1_epi32(v); }
inline Floats fma(Floats a, Floats b, Floats c) { return _mm256_fmadd_ps(a, b, c); }
inline Floats largest_absolute(Floats a, Floats b) {
  const Floats sign = _mm256_set1_ps(-0.0f);
  return _mm256_max_ps(_mm256_andnot_ps(sign, a), _mm256_andnot_ps(sign, b));
}
inline Floats root_inverse(Floats v) { return _mm256_rsqrt_ps(v); }
inline Floats inverse(Floats v) { return _mm256_rcp_ps(v); }
inline Ints bits(Floats v) { return _mm256_castps_si256(v); }
inline Floats floats(Ints v) { return _mm256_castsi256_ps(v); }
inline Ints truncate(Floats v) { return _mm256_cvttps_epi32(v); }
template <int N>
inline Ints right(Ints v) {
  return _mm256_srli_epi32(v, N);
}
template <int N>
inline Ints left(Ints v) {
  return _mm256_slli_epi32(v, N);
}
inline Ints left(Ints v, Ints by) { return _mm256_sllv_epi32(v, by); }
inline Ints add(Ints a, Ints b) { return _mm256_add_epi32(a, b); }
inline Ints subtract(Ints a, Ints b) { return _mm256_sub_epi32(a, b); }
inline Ints greatest(Ints a, Ints b) { return _mm256_max_epi32(a, b); }
inline Ints gather(const std::uint32_t* p, Ints at) {
  return _mm256_i32gather_epi32(reinterpret_cast<const int*>(p), at, 4);
}
inline Mask at_least(Floats a, Floats b) { return _mm256_cmp_ps(a, b, _CMP_GE_OQ); }
inline Floats zero_where(Mask m, Floats v) { return _mm256_andnot_ps(m, v); }
inline Floats greatest(Floats a, Floats b) { return _mm256_max_ps(a, b); }
#else
#error "needs AVX2 or AVX-512"
#endif

// One sphere, ready made: centre (x + y, x - y), z, 2 z^2, 4 r^2, and 2^1.5 pi z r^2.
struct Sphere {
  float a, b, z, z2, r2, weight;
};

extern "C" int cone_sum_width() { return kWidth; }

// Ratio of the light with and without the spheres at points (x, y), `count` of them, a multiple of
// kWidth. table: the levels, 2^finest texels wide at the largest; scale: what the sums of its
// floats become shares with, by channel.
extern "C" void cone_sum(const float* x, const float* y, int count, const Sphere* spheres,
                         int sphere_count, const std::uint32_t* table, int finest,
                         const float* scale, float* red, float* green, float* blue) {
  const Ints coarsest = all(std::int32_t(64 - finest)), k_zero = all(std::int32_t(64));
  // Bits of 2^63 less 2^-10 of it: a texel's place then stays within its row for any error of the
  // reciprocal.
  const Ints half_zero = all(std::int32_t((190 << 23) - 16384));
  const Floats column_zero = all(1.0005f), row_zero = all(3.0025f);
  for (int i = 0; i < count; i += kWidth) {
    const Floats px = load(x + i), py = load(y + i), pa = px + py, pb = px - py;
    Floats r = all(0.0f), g = r, b = r, widest = r;
    for (const Sphere* s = spheres; s < spheres + sphere_count; ++s) {
      const Floats da = all(s->a) - pa, db = all(s->b) - pb;
      const Floats per_d =
          root_inverse(fma(da, da, fma(db, db, all(s->z2))));           // 1 / (sqrt(2) distance)
      const Floats per_d2 = per_d * per_d, sin2 = all(s->r2) * per_d2;  // 2 sin^2 alpha
      widest = greatest(widest, sin2);
      const Floats weight = all(s->weight) * (per_d2 * per_d);           // pi sin^2 alpha cos theta
      const Ints level = greatest(right<24>(bits(sin2)), coarsest);      // 64 - k
      const Floats half = floats(subtract(half_zero, left<23>(level)));  // 2^k / 2
      const Floats to_square = inverse(largest_absolute(da, db) + all(s->z));
      const Ints column = truncate(fma(da, to_square, column_zero) * half);
      const Ints row = truncate(fma(db, to_square, row_zero) * half);  // and 2^k
      const Ints texel = gather(table, add(column, left(row, subtract(k_zero, level))));
      r = fma(weight, floats(right<4>(left<21>(texel))), r);
      g = fma(weight, floats(right<4>(left<10>(texel))), g);
      b = fma(weight, floats(right<4>(texel)), b);
    }
    const Floats one = all(1.0f), nothing = all(0.0f);
    const Mask inside = at_least(widest, all(2.0f));  // of a sphere, or on it
    store(red + i, zero_where(inside, greatest(one - r * all(scale[0]), nothing)));
    store(green + i, zero_where(inside, greatest(one - g * all(scale[1]), nothing)));
    store(blue + i, zero_where(inside, greatest(one - b * all(scale[2]), nothing)));
  }
}
