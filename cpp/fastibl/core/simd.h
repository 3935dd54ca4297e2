// FASTIBL_CLONES on a function compiles it for plain x86-64 and for AVX2 + FMA and picks at run
// time. The function must be plain loops over arrays: inline functions of other headers would be
// compiled without the attribute. Results can differ in the last bits between the two, never
// between threads.
#pragma once

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_THREAD__)
#define FASTIBL_CLONES __attribute__((target_clones("default", "arch=x86-64-v3")))
// For loops that are written in vectors of 16 floats: AVX-512 as well.
#define FASTIBL_WIDE_CLONES \
  __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#else
#define FASTIBL_CLONES
#define FASTIBL_WIDE_CLONES
#endif
