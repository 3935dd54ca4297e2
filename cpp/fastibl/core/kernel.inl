// Includes the file FASTIBL_KERNEL in namespace `portable` and, where there may be AVX2, in
// namespace `avx2`, with FASTIBL_KERNEL_AVX512 also in `avx512`: see core/wide.h. FASTIBL_PICK then
// names what runs on this processor.

namespace portable {
#define FASTIBL_TARGET
#include FASTIBL_KERNEL
#undef FASTIBL_TARGET
#undef FASTIBL_KERNEL_INLINE
}  // namespace portable
#ifdef FASTIBL_WITH_AVX2
namespace avx2 {
#define FASTIBL_IN_AVX2
#define FASTIBL_TARGET __attribute__((target("avx2,fma")))
#include FASTIBL_KERNEL
#undef FASTIBL_TARGET
#undef FASTIBL_KERNEL_INLINE
#undef FASTIBL_IN_AVX2
}  // namespace avx2
#ifdef FASTIBL_KERNEL_AVX512
namespace avx512 {
#define FASTIBL_IN_AVX512
#define FASTIBL_TARGET __attribute__((target("avx2,fma,avx512f,avx512bw,avx512dq,avx512vl")))
#include FASTIBL_KERNEL
#undef FASTIBL_TARGET
#undef FASTIBL_KERNEL_INLINE
#undef FASTIBL_IN_AVX512
}  // namespace avx512
#endif
#endif
#undef FASTIBL_KERNEL
#undef FASTIBL_KERNEL_AVX512
