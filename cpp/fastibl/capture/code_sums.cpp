#include "fastibl/capture/code_sums.h"

#include <algorithm>
#include <cstring>

#include "fastibl/core/simd.h"

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>
#define FASTIBL_BYTE_SHUFFLES
#ifndef __clang__  // GCC's own header: https://gcc.gnu.org/bugzilla/show_bug.cgi?id=105593
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#endif

namespace fastibl {
namespace {

constexpr float kScale = 0.25f / CodeTable::kUnit;
constexpr std::uint32_t kValue = (1u << CodeTable::kCountShift) - 1;

constexpr int kRowsAhead = 4;

// Sums over 2 × 2 pixels of three channels; the fourth number stays as it is.
void sum_pairs(const std::uint32_t* table, const std::uint8_t* a, const std::uint8_t* b, int pairs,
               std::uint32_t* sums) {
  for (int x = 0; x < pairs; ++x, a += 6, b += 6, sums += 4)
    for (int c = 0; c < 3; ++c)
      sums[c] = (table[a[c]] + table[a[c + 3]]) + (table[b[c]] + table[b[c + 3]]);
}

// False if any pixel is clipped.
FASTIBL_CLONES bool to_pixels(const std::uint32_t* sums, int pairs, float* pixels) {
  using Ints [[gnu::vector_size(16)]] = std::int32_t;
  const Float4 scale = {kScale, kScale, kScale, 0};
  Ints any = {};
  for (int x = 0; x < pairs; ++x, sums += 4, pixels += 4) {
    Ints four;
    std::memcpy(&four, sums, sizeof four);
    any |= four;
    const Float4 mean = __builtin_convertvector(four & std::int32_t(kValue), Float4) * scale;
    std::memcpy(pixels, &mean, sizeof mean);
  }
  return CodeTable::count(std::uint32_t(any[0] | any[1] | any[2])) == 0;
}

#ifdef FASTIBL_BYTE_SHUFFLES
// Holds the table of 256 codes as three planes of bytes in registers: of each plane, two shuffles
// look up 64 codes. Makes four outputs at a time, whose clipped pixels it counts; returns how many
// were made.
__attribute__((target("avx512f,avx512bw,avx512vbmi,avx512vnni"))) int shuffle_codes(
    const std::uint8_t* planes, int clipped_code, const std::uint8_t* a, const std::uint8_t* b,
    int pairs, float* pixels, std::uint32_t* clipped) {
  alignas(64) std::uint8_t order[64];  // the four codes of each sum side by side; b's follow a's 64
  for (int x = 0; x < 4; ++x)
    for (int c = 0; c < 4; ++c) {
      const int at = 6 * x + (c < 3 ? c : 0);
      std::uint8_t* to = order + 4 * (4 * x + c);
      to[0] = std::uint8_t(at), to[1] = std::uint8_t(at + 3);
      to[2] = std::uint8_t(at + 64), to[3] = std::uint8_t(at + 67);
    }
  const __m512i gather = _mm512_load_si512(order);
  const __m512i one8 = _mm512_set1_epi8(1);
  const __m512i limit = _mm512_set1_epi8(char(clipped_code));
  __m512i t[3][4];
  for (int p = 0; p < 3; ++p)
    for (int q = 0; q < 4; ++q) t[p][q] = _mm512_loadu_si512(planes + 256 * p + 64 * q);
  const __m512 scale = _mm512_set1_ps(kScale);
  const __m512i fields = _mm512_set4_epi32(0, 2 * kCountBits, kCountBits, 0);
  // A camera's picture lies in memory that no core has read yet, so coming rows are prefetched.
  const std::uint8_t* ahead = a + kRowsAhead * (b - a);
  constexpr __mmask64 used = (1u << 24) - 1;  // bytes of a row, for four outputs
  constexpr int kTogether = 64;
  const int groups = pairs / 4;
  for (int first = 0; first < groups; first += kTogether) {
    const int count = std::min(groups - first, kTogether);
    __mmask64 over[kTogether], any = 0;  // looked at later, so that no branch waits for a look-up
    for (int i = 0; i < count; ++i, a += 24, b += 24, ahead += 48, pixels += 16) {
      const __m512i codes = _mm512_permutex2var_epi8(_mm512_maskz_loadu_epi8(used, a), gather,
                                                     _mm512_maskz_loadu_epi8(used, b));
      __builtin_prefetch(ahead);
      over[i] = _mm512_cmpge_epu8_mask(codes, limit);
      any |= over[i];
      const __mmask64 upper = _mm512_movepi8_mask(codes);
      __m512i value = _mm512_setzero_si512();  // four codes' bytes at once, the highest first
      // Does all shuffles, whatever the codes: a branch around half of them, for neighbours that
      // are all dark or all bright, is mispredicted so often that it takes more time than it saves.
      for (int p = 2; p >= 0; --p) {
        const __m512i bytes =
            _mm512_mask_mov_epi8(_mm512_permutex2var_epi8(t[p][0], codes, t[p][1]), upper,
                                 _mm512_permutex2var_epi8(t[p][2], codes, t[p][3]));
        value = _mm512_dpbusd_epi32(_mm512_slli_epi32(value, 8), bytes, one8);
      }
      _mm512_storeu_ps(pixels, _mm512_maskz_mul_ps(0x7777, _mm512_cvtepi32_ps(value), scale));
      _mm_storeu_si128(reinterpret_cast<__m128i*>(clipped + 4 * i), _mm_setzero_si128());
    }
    for (int i = 0; any && i < count; ++i) {
      if (!over[i]) continue;
      // Counts of the three channels side by side in one number.
      const __m512i counts =
          _mm512_dpbusd_epi32(_mm512_setzero_si512(), _mm512_maskz_mov_epi8(over[i], one8), one8);
      __m512i packed = _mm512_maskz_sllv_epi32(0x7777, counts, fields);
      packed = _mm512_or_si512(packed, _mm512_shuffle_epi32(packed, _MM_PERM_BADC));
      packed = _mm512_or_si512(packed, _mm512_shuffle_epi32(packed, _MM_PERM_CDAB));
      const __mmask16 some = _mm512_test_epi32_mask(packed, packed);
      _mm512_mask_storeu_ps(pixels + 16 * (i - count), __mmask16(some & 0x8888), _mm512_set1_ps(1));
      _mm_storeu_si128(reinterpret_cast<__m128i*>(clipped + 4 * i),
                       _mm512_castsi512_si128(_mm512_maskz_compress_epi32(0x1111, packed)));
    }
    clipped += 4 * count;
  }
  return 4 * groups;
}

bool has_byte_shuffles() {
  static const bool has = __builtin_cpu_supports("avx512bw") &&
                          __builtin_cpu_supports("avx512vbmi") &&
                          __builtin_cpu_supports("avx512vnni");
  return has;
}
#endif

}  // namespace

CodeTable::CodeTable(const Response& response) : clipped_code(response.clipped_code()) {
  for (std::size_t k = 0; k < 256; ++k) {
    const auto value =
        std::uint32_t(double(response.decode(float(k) / 255.0f)) * double(kUnit) + 0.5);
    sums[k] = value + (int(k) >= clipped_code ? 1u << kCountShift : 0u);
    for (std::size_t p = 0; p < 3; ++p) planes[256 * p + k] = std::uint8_t(value >> 8 * p);
  }
}

void decode_pairs(const CodeTable& table, const std::uint8_t* a, const std::uint8_t* b, int pairs,
                  std::uint32_t* scratch, float* pixels, std::uint32_t* clipped) {
  int done = 0;
#ifdef FASTIBL_BYTE_SHUFFLES
  if (has_byte_shuffles())
    done = shuffle_codes(table.planes.data(), table.clipped_code, a, b, pairs, pixels, clipped);
#endif
  a += 6 * done, b += 6 * done, pairs -= done, pixels += 4 * done, clipped += done;
  sum_pairs(table.sums.data(), a, b, pairs, scratch);
  if (to_pixels(scratch, pairs, pixels)) {
    std::fill_n(clipped, pairs, 0u);
    return;
  }
  for (int x = 0; x < pairs; ++x, scratch += 4) {
    std::uint32_t counts = 0;
    for (int c = 0; c < 3; ++c) counts |= CodeTable::count(scratch[c]) << c * kCountBits;
    clipped[x] = counts;
    if (counts) pixels[4 * x + 3] = 1;
  }
}

}  // namespace fastibl
