// FASTIBL_CLONES on a function compiles it for plain x86-64, for AVX2 + FMA and for AVX-512, and
// picks at run time. The function must be plain loops over arrays: inline functions of other
// headers would be compiled without the attribute, unless they are inlined. Products and sums are
// never contracted, so that a loop without a reordered sum gives the same bits on all three.
//
// Not without optimization: a lambda in it that is not inlined is compiled for plain x86-64, where
// wide vectors are passed in other registers.
#pragma once

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && \
    defined(__OPTIMIZE__) && !defined(__OPTIMIZE_SIZE__) && !defined(__SANITIZE_THREAD__)
#define FASTIBL_CLONES __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#else
#define FASTIBL_CLONES
#endif

// Numbers side by side, for loops that are to be vectorised in one certain way; at any address of a
// float. Wider than the processor's they are worked on in parts.
#if defined(__GNUC__)
namespace fastibl {
using Float4 [[gnu::vector_size(16), gnu::aligned(4)]] = float;
using Float8 [[gnu::vector_size(32), gnu::aligned(4)]] = float;
using Float16 [[gnu::vector_size(64), gnu::aligned(4)]] = float;
using Int16 [[gnu::vector_size(64), gnu::aligned(4)]] = int;
}  // namespace fastibl
#else
#error "fastibl needs the vector types of GCC or Clang"
#endif

// For short helpers of such functions: inlined, they are compiled as their caller is.
#define FASTIBL_INLINE inline __attribute__((always_inline))
