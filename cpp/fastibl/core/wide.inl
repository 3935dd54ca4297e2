// What kernels of Wide share; see core/wide.h. Included in namespaces `portable` and `avx2`.

// For short helpers of kernels, which are compiled as their caller is.
#define FASTIBL_KERNEL_INLINE FASTIBL_TARGET inline __attribute__((always_inline))

#ifdef FASTIBL_IN_AVX2

FASTIBL_KERNEL_INLINE Wide larger(Wide a, Wide b) { return _mm256_max_ps(a, b); }
FASTIBL_KERNEL_INLINE Wide smaller(Wide a, Wide b) { return _mm256_min_ps(a, b); }
FASTIBL_KERNEL_INLINE Wide multiply_add(Wide a, Wide b, Wide c) { return _mm256_fmadd_ps(a, b, c); }
FASTIBL_KERNEL_INLINE Wide repeat(float value) { return _mm256_set1_ps(value); }
FASTIBL_KERNEL_INLINE unsigned set_bits(WideInt mask) {
  return unsigned(_mm256_movemask_ps(_mm256_castsi256_ps((__m256i)mask)));
}

// Eight vectors x y z x y z … to a register of each, and back: Melax, 3D Vector Normalization Using
// 256-Bit Intel Advanced Vector Extensions, 2011.
FASTIBL_KERNEL_INLINE void load_vectors(const float* p, Wide& x, Wide& y, Wide& z) {
  const auto halves = [](const float* low, const float* high) FASTIBL_TARGET {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(low)), _mm_loadu_ps(high), 1);
  };
  const __m256 a = halves(p, p + 12), b = halves(p + 4, p + 16), c = halves(p + 8, p + 20);
  const __m256 xy = _mm256_shuffle_ps(b, c, _MM_SHUFFLE(2, 1, 3, 2));
  const __m256 yz = _mm256_shuffle_ps(a, b, _MM_SHUFFLE(1, 0, 2, 1));
  x = _mm256_shuffle_ps(a, xy, _MM_SHUFFLE(2, 0, 3, 0));
  y = _mm256_shuffle_ps(yz, xy, _MM_SHUFFLE(3, 1, 2, 0));
  z = _mm256_shuffle_ps(yz, c, _MM_SHUFFLE(3, 0, 3, 1));
}
FASTIBL_KERNEL_INLINE void store_vectors(float* p, Wide x, Wide y, Wide z) {
  const __m256 xy = _mm256_shuffle_ps(x, y, _MM_SHUFFLE(2, 0, 2, 0));
  const __m256 yz = _mm256_shuffle_ps(y, z, _MM_SHUFFLE(3, 1, 3, 1));
  const __m256 zx = _mm256_shuffle_ps(z, x, _MM_SHUFFLE(3, 1, 2, 0));
  const __m256 a = _mm256_shuffle_ps(xy, zx, _MM_SHUFFLE(2, 0, 2, 0));
  const __m256 b = _mm256_shuffle_ps(yz, xy, _MM_SHUFFLE(3, 1, 2, 0));
  const __m256 c = _mm256_shuffle_ps(zx, yz, _MM_SHUFFLE(3, 1, 3, 1));
  _mm_storeu_ps(p, _mm256_castps256_ps128(a));
  _mm_storeu_ps(p + 4, _mm256_castps256_ps128(b));
  _mm_storeu_ps(p + 8, _mm256_castps256_ps128(c));
  _mm_storeu_ps(p + 12, _mm256_extractf128_ps(a, 1));
  _mm_storeu_ps(p + 16, _mm256_extractf128_ps(b, 1));
  _mm_storeu_ps(p + 20, _mm256_extractf128_ps(c, 1));
}
// Eight rows to eight columns.
FASTIBL_KERNEL_INLINE void transpose(Wide (&r)[kWide]) {
  Wide pairs[kWide], fours[kWide];
  for (int k = 0; k < kWide; k += 2)
    pairs[k] = _mm256_unpacklo_ps(r[k], r[k + 1]), pairs[k + 1] = _mm256_unpackhi_ps(r[k], r[k + 1]);
  for (int k = 0; k < kWide; k += 4)
    for (int h = 0; h < 2; ++h) {
      const Wide a = pairs[k + h], b = pairs[k + 2 + h];
      fours[k + 2 * h] = _mm256_shuffle_ps(a, b, _MM_SHUFFLE(1, 0, 1, 0));
      fours[k + 2 * h + 1] = _mm256_shuffle_ps(a, b, _MM_SHUFFLE(3, 2, 3, 2));
    }
  for (int k = 0; k < kWide / 2; ++k) {
    r[k] = _mm256_permute2f128_ps(fours[k], fours[k + 4], 0x20);
    r[k + 4] = _mm256_permute2f128_ps(fours[k], fours[k + 4], 0x31);
  }
}

#else

FASTIBL_KERNEL_INLINE Wide larger(Wide a, Wide b) { return a > b ? a : b; }
FASTIBL_KERNEL_INLINE Wide smaller(Wide a, Wide b) { return a < b ? a : b; }
FASTIBL_KERNEL_INLINE Wide multiply_add(Wide a, Wide b, Wide c) { return a * b + c; }
FASTIBL_KERNEL_INLINE Wide repeat(float value) {
  return Wide{value, value, value, value, value, value, value, value};
}
FASTIBL_KERNEL_INLINE unsigned set_bits(WideInt mask) {
  unsigned bits = 0;
  for (int k = 0; k < kWide; ++k) bits |= unsigned(mask[k] & 1) << k;
  return bits;
}
FASTIBL_KERNEL_INLINE void load_vectors(const float* p, Wide& x, Wide& y, Wide& z) {
  for (int i = 0; i < kWide; ++i) x[i] = p[3 * i], y[i] = p[3 * i + 1], z[i] = p[3 * i + 2];
}
FASTIBL_KERNEL_INLINE void store_vectors(float* p, Wide x, Wide y, Wide z) {
  for (int i = 0; i < kWide; ++i) p[3 * i] = x[i], p[3 * i + 1] = y[i], p[3 * i + 2] = z[i];
}
FASTIBL_KERNEL_INLINE void transpose(Wide (&r)[kWide]) {
  for (int i = 0; i < kWide; ++i)
    for (int k = 0; k < i; ++k) {
      const float a = r[i][k];
      r[i][k] = r[k][i], r[k][i] = a;
    }
}

#endif
