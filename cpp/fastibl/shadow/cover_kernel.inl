// The sum over the entries of one block; see core/wide.h for how it is compiled.

#include "fastibl/core/wide.inl"

typedef std::uint8_t Bytes __attribute__((vector_size(8)));

#ifdef FASTIBL_IN_AVX2
FASTIBL_KERNEL_INLINE Wide numbers(const std::uint8_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i*)p)));
}
#else
FASTIBL_KERNEL_INLINE Wide numbers(const std::uint8_t* p) {
  Bytes bytes;
  std::memcpy(&bytes, p, sizeof bytes);
  return __builtin_convertvector(bytes, Wide);
}
#endif

// source, cover: of `count` entries, 16 bytes each. weights: four a source. sums: 16 texels' red,
// then green, then blue.
FASTIBL_TARGET void add_block(const std::uint16_t* source, const std::uint8_t* cover,
                              std::size_t count, const float* weights, float* sums) {
  Wide sum[6];
  std::memcpy(sum, sums, sizeof sum);
  for (std::size_t i = 0; i < count; ++i) {
    const float* w = weights + 4 * source[i];
    const Wide red = repeat(w[0]), green = repeat(w[1]), blue = repeat(w[2]);
    const Wide first = numbers(cover + 16 * i), second = numbers(cover + 16 * i + 8);
    sum[0] = multiply_add(first, red, sum[0]), sum[1] = multiply_add(second, red, sum[1]);
    sum[2] = multiply_add(first, green, sum[2]), sum[3] = multiply_add(second, green, sum[3]);
    sum[4] = multiply_add(first, blue, sum[4]), sum[5] = multiply_add(second, blue, sum[5]);
  }
  std::memcpy(sums, sum, sizeof sum);
}
