// Includes the file FASTIBL_KERNEL in namespace `portable` and, where there may be AVX2, in
// namespace `avx2`: see core/wide.h. FASTIBL_PICK then names what runs on this processor.

namespace portable {
#define FASTIBL_TARGET
#include FASTIBL_KERNEL
#undef FASTIBL_TARGET
}  // namespace portable
#ifdef FASTIBL_WITH_AVX2
namespace avx2 {
#define FASTIBL_IN_AVX2
#define FASTIBL_TARGET __attribute__((target("avx2,fma")))
#include FASTIBL_KERNEL
#undef FASTIBL_TARGET
#undef FASTIBL_IN_AVX2
}  // namespace avx2
#endif
#undef FASTIBL_KERNEL
