// The sum over the entries of one block; see core/wide.h for how it is compiled.

#include "fastibl/core/wide.inl"

// The texels of a block.
#if defined(FASTIBL_IN_AVX512)
typedef __m512 Block;
FASTIBL_KERNEL_INLINE Block load(const float* p) { return _mm512_loadu_ps(p); }
FASTIBL_KERNEL_INLINE void store(float* p, Block block) { _mm512_storeu_ps(p, block); }
FASTIBL_KERNEL_INLINE Block numbers(const std::uint8_t* p) {
  return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i*)p)));
}
FASTIBL_KERNEL_INLINE Block add_product(Block block, float factor, Block sum) {
  return _mm512_fmadd_ps(block, _mm512_set1_ps(factor), sum);
}
FASTIBL_KERNEL_INLINE Block sum_of(Block a, Block b) { return _mm512_add_ps(a, b); }
FASTIBL_KERNEL_INLINE Block same(float value) { return _mm512_set1_ps(value); }
#else
struct Block {
  Wide first, second;
};
FASTIBL_KERNEL_INLINE Block load(const float* p) {
  Block block;
  std::memcpy(&block, p, sizeof block);
  return block;
}
FASTIBL_KERNEL_INLINE void store(float* p, Block block) { std::memcpy(p, &block, sizeof block); }
#ifdef FASTIBL_IN_AVX2
FASTIBL_KERNEL_INLINE Wide eight_numbers(const std::uint8_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i*)p)));
}
#else
typedef std::uint8_t Bytes __attribute__((vector_size(8)));
FASTIBL_KERNEL_INLINE Wide eight_numbers(const std::uint8_t* p) {
  Bytes bytes;
  std::memcpy(&bytes, p, sizeof bytes);
  return __builtin_convertvector(bytes, Wide);
}
#endif
FASTIBL_KERNEL_INLINE Block numbers(const std::uint8_t* p) {
  return {eight_numbers(p), eight_numbers(p + 8)};
}
FASTIBL_KERNEL_INLINE Block add_product(Block block, float factor, Block sum) {
  const Wide w = repeat(factor);
  return {multiply_add(block.first, w, sum.first), multiply_add(block.second, w, sum.second)};
}
FASTIBL_KERNEL_INLINE Block sum_of(Block a, Block b) {
  return {a.first + b.first, a.second + b.second};
}
FASTIBL_KERNEL_INLINE Block same(float value) { return {repeat(value), repeat(value)}; }
#endif

// source, cover: of `count` entries, 16 bytes each. weights: four a source. everywhere: of three
// channels. sums: 16 texels' red, then green, then blue.
FASTIBL_TARGET void add_block(const std::uint16_t* source, const std::uint8_t* cover,
                              std::size_t count, const float* weights, const float* everywhere,
                              float* sums) {
  // Every other entry has its own sums: two that do not wait for each other.
  Block even[3], odd[3];
  for (int c = 0; c < 3; ++c) {
    even[c] = load(sums + 16 * c);
    odd[c] = same(everywhere[c]);
  }
  const auto add = [&](std::size_t i, Block* sum) FASTIBL_TARGET {
    const float* w = weights + 4 * source[i];
    const Block block = numbers(cover + 16 * i);
    for (int c = 0; c < 3; ++c) sum[c] = add_product(block, w[c], sum[c]);
  };
  std::size_t i = 0;
  for (; i + 1 < count; i += 2) add(i, even), add(i + 1, odd);
  if (i < count) add(i, even);
  for (int c = 0; c < 3; ++c) store(sums + 16 * c, sum_of(even[c], odd[c]));
}
