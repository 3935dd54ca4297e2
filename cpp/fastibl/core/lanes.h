// Sixteen floats side by side, a vector type of GCC and Clang: one register of AVX-512, two of
// AVX2, four of SSE. For functions with FASTIBL_CLONES; what these call must be inlined into them.
// A loop that carries such vectors from round to round does so through memory where they take
// several registers: FASTIBL_BY_WIDTH is for such loops.
#pragma once

#include <cstdint>

#include "fastibl/core/simd.h"

namespace fastibl {

inline constexpr int kLanes = 16;
typedef float Lanes __attribute__((vector_size(64)));
typedef std::int32_t IntLanes __attribute__((vector_size(64)));

FASTIBL_INLINE float total(const Lanes& a) {
  float sum = 0;
  add_each(a, sum);
  return sum;
}

// ln(1 − t) for t in [0, 1), to 2e-7 of its value, also where t is small. V: any number of floats.
template <typename V>
FASTIBL_INLINE void log1m(const V& t, V& result) {
  // 1 − t = m 2^e with m in [√½, √2): where e is 0, m − 1 is −t, which keeps its digits.
  const IntsOf<V> bits = reinterpret_cast<IntsOf<V>>(1 - t);
  const IntsOf<V> e = (bits - 0x3f3504f3) >> 23;
  const V m = reinterpret_cast<V>(bits - (e << 23));
  const V v = e == 0 ? -t : m - 1;
  const V u = v / (2 + v), q = u * u;  // ln(1 + v) = 2 artanh(v/(2 + v)), |u| ≤ 0.172
  result = __builtin_convertvector(e, V) * 0.69314718f +
           2 * u * (1 + q * (1 / 3.0f + q * (0.2f + q * (1 / 7.0f + q * (1 / 9.0f)))));
}

// exp(x) for x ≤ 0, to 2e-7; 0 below −87. V: any number of floats.
template <typename V>
FASTIBL_INLINE void exp_negative(const V& x, V& result) {
  const V y = (x > -87 ? x : V{} - 87) * 1.44269504f;
  const auto e = __builtin_convertvector(y - 0.5f, IntsOf<V>);  // nearest: y ≤ 0
  const V f = (y - __builtin_convertvector(e, V)) * 0.69314718f;
  const V p =
      1 + f * (1 + f * (0.5f + f * (1 / 6.0f + f * (1 / 24.0f + f * (1 / 120.0f + f / 720.0f)))));
  const V value = p * reinterpret_cast<V>((e + 127) << 23);
  result = x > -87 ? value : V{};
}

}  // namespace fastibl
