// Eight floats at once, for kernels that the compiler does not vectorise by itself. A kernel is a
// file, named by FASTIBL_KERNEL, that core/kernel.inl compiles twice: FASTIBL_TARGET stands before
// each of its functions, and FASTIBL_PICK(function) gives the version for this processor. Results
// can differ in the last bits between the two versions, never between threads. With
// FASTIBL_KERNEL_AVX512 defined, the kernel is compiled a third time, and FASTIBL_PICK_AVX512
// chooses among three. The portable version runs until the file that uses it is initialised, as
// when it is called from global objects of other files.
#pragma once

#include <cstring>

namespace fastibl {

typedef float Wide __attribute__((vector_size(32)));
typedef int WideInt __attribute__((vector_size(32)));
inline constexpr int kWide = 8;

#if defined(__x86_64__) && defined(__linux__) && !defined(__SANITIZE_THREAD__)
#define FASTIBL_WITH_AVX2
inline bool has_avx2() {
  static const bool yes = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  return yes;
}
inline bool has_avx512() {
#ifdef FASTIBL_NO_AVX512  // see core/simd.h
  return false;
#else
  static const bool yes = has_avx2() && __builtin_cpu_supports("avx512bw") &&
                          __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  return yes;
#endif
}
#define FASTIBL_PICK(function)         \
  auto* function = portable::function; \
  [[maybe_unused]] const auto picked_##function = function = has_avx2() ? avx2::function : function
#define FASTIBL_PICK_AVX512(function)                        \
  auto* function = portable::function;                       \
  [[maybe_unused]] const auto picked_##function = function = \
      has_avx512() ? avx512::function : (has_avx2() ? avx2::function : function)
#else
#define FASTIBL_PICK(function) const auto function = portable::function
#define FASTIBL_PICK_AVX512(function) FASTIBL_PICK(function)
#endif

}  // namespace fastibl
