// FASTIBL_CLONES on a function compiles it for plain x86-64, for AVX2 + FMA and for AVX-512, and
// picks one at run time. The function must consist of plain loops over arrays: inline functions of
// other headers would be compiled without the attribute, unless they are inlined. Products and sums
// are never contracted, so that a loop without a reordered sum gives the same bits on all three. It
// must be local to its file: GCC shows the function that picks one to other libraries, whatever
// -fvisibility says.
//
// Not used without optimization: inline functions that are not inlined are then compiled for plain
// x86-64. Nor where the whole is compiled for more than a version has: GCC inlines no function with
// instructions that its caller lacks.
#pragma once

#include <cmath>
#include <cstring>

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && \
    defined(__OPTIMIZE__) && !defined(__OPTIMIZE_SIZE__) && !defined(__SANITIZE_THREAD__) && \
    !defined(__AES__) && !defined(__PCLMUL__) && !defined(__AVX512F__) && !defined(__SHA__)
#define FASTIBL_VERSIONS
#endif

// CMake's FASTIBL_AVX512=OFF: everything runs as on a processor with AVX2.
#ifdef FASTIBL_NO_AVX512
#define FASTIBL_WITH_V4(...)
#else
#define FASTIBL_WITH_V4(...) __VA_ARGS__
#endif

#ifdef FASTIBL_VERSIONS
#define FASTIBL_CLONES \
  __attribute__((target_clones("default", "arch=x86-64-v3" FASTIBL_WITH_V4(, "arch=x86-64-v4"))))
#else
#define FASTIBL_CLONES
#endif

// Floats side by side, for loops that must be vectorised in one particular way; at any address of a
// float. Vectors wider than the processor's are worked on in parts.
#if defined(__GNUC__)
namespace fastibl {
using Float4 [[gnu::vector_size(16), gnu::aligned(4)]] = float;
using Float8 [[gnu::vector_size(32), gnu::aligned(4)]] = float;
using Float16 [[gnu::vector_size(64), gnu::aligned(4)]] = float;

// For short helpers of functions with FASTIBL_CLONES: inlined, they are compiled as their caller
// is.
#define FASTIBL_INLINE inline __attribute__((always_inline))
// The same for a lambda that takes or returns wide vectors, behind its parameters: a call would pass
// them in other registers than the caller's.
#define FASTIBL_INLINED __attribute__((always_inline))

// For templates whose argument V is one of these types: how many floats it holds, what its
// comparisons give, and how it is read and written. (A template's argument loses the alignment.)
template <typename V>
inline constexpr int kFloatsIn = int(sizeof(V) / sizeof(float));
template <typename V>
using IntsOf = decltype(V{} > V{});

template <typename V>
FASTIBL_INLINE V floats_at(const float* p) {
  V floats;
  std::memcpy(&floats, p, sizeof floats);
  return floats;
}
template <typename V>
FASTIBL_INLINE IntsOf<V> ints_at(const int* p) {
  IntsOf<V> ints;
  std::memcpy(&ints, p, sizeof ints);
  return ints;
}
template <typename V>
FASTIBL_INLINE void put_floats(const V& floats, float* p) {
  std::memcpy(p, &floats, sizeof floats);
}
template <typename V>
FASTIBL_INLINE void square_root(const V& x, V& result) {
  for (int k = 0; k < kFloatsIn<V>; ++k) result[k] = std::sqrt(x[k]);
}
// Adds one after the other, so that sums in parts are the same as those of sixteen at once.
template <typename V>
FASTIBL_INLINE void add_each(const V& floats, float& sum) {
  for (int k = 0; k < kFloatsIn<V>; ++k) sum += floats[k];
}
}  // namespace fastibl
#else
#error "fastibl needs the vector types of GCC or Clang"
#endif

// FASTIBL_BY_WIDTH(result function(parameters), call) defines a function that calls a template with
// V, a vector of as many floats as a register of the processor holds. Wider vectors are not kept in
// registers from one round of a loop to the next. Sums must be made in sixteen parts, of which V
// takes some at a time, so that all processors give the same bits.
#ifdef FASTIBL_VERSIONS
#define FASTIBL_BY_WIDTH(function, ...)                                \
  __attribute__((target("default"))) function {                        \
    using V = Float4;                                                  \
    return __VA_ARGS__;                                                \
  }                                                                    \
  __attribute__((target("arch=x86-64-v3"))) function {                 \
    using V = Float8;                                                  \
    return __VA_ARGS__;                                                \
  }                                                                    \
  FASTIBL_WITH_V4(__attribute__((target("arch=x86-64-v4"))) function { \
    using V = Float16;                                                 \
    return __VA_ARGS__;                                                \
  })
#else
#define FASTIBL_BY_WIDTH(function, ...) \
  function {                            \
    using V = Float4;                   \
    return __VA_ARGS__;                 \
  }
#endif
