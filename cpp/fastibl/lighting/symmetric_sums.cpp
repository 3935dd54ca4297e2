// Compiled with contraction into fused multiply-adds (CMakeLists.txt), which doubles the speed.
#include "fastibl/lighting/symmetric_sums.h"

#include <algorithm>

#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kPart = 64;  // texels whose values of one channel stay in the first-level cache

// One part, for one channel and two outputs: up to twelve wide sums stay in registers.
template <typename V>
FASTIBL_INLINE void add_part_by(const SymmetricTexel* texels, const std::uint32_t* slots,
                                const float* weights, int count, int channel, float* first,
                                float* second) {
  constexpr int kSums = std::min(6, kCubeSymmetries / kFloatsIn<V>);
  for (int begin = 0; begin < kCubeSymmetries; begin += kSums * kFloatsIn<V>) {
    V a[kSums]{}, b[kSums]{};
    for (int i = 0; i < count; ++i) {
      const float* value = texels[slots[i]].values[channel] + begin;
      const float to_first = weights[i * kOutputs], to_second = weights[i * kOutputs + 1];
      for (int k = 0; k < kSums; ++k) {
        const V v = floats_at<V>(value + k * kFloatsIn<V>);
        a[k] += to_first * v, b[k] += to_second * v;
      }
    }
    for (int k = 0; k < kSums; ++k) {
      const int at = begin + k * kFloatsIn<V>;
      put_floats(floats_at<V>(first + at) + a[k], first + at);
      put_floats(floats_at<V>(second + at) + b[k], second + at);
    }
  }
}
FASTIBL_BY_WIDTH(void add_part(const SymmetricTexel* texels, const std::uint32_t* slots,
                               const float* weights, int count, int channel, float* first,
                               float* second),
                 add_part_by<V>(texels, slots, weights, count, channel, first, second))

}  // namespace

void add_symmetric_sums(std::span<const SymmetricTexel> texels,
                        std::span<const std::uint32_t> slots, const float* weights, int outputs,
                        SymmetricTexel* sums) {
  alignas(64) float unused[kCubeSymmetries];
  for (std::size_t begin = 0; begin < slots.size(); begin += kPart) {
    const int count = int(std::min(slots.size() - begin, std::size_t(kPart)));
    for (int c = 0; c < 3; ++c)
      for (int o = 0; o < outputs; o += 2)
        add_part(texels.data(), &slots[begin], &weights[begin * kOutputs + std::size_t(o)], count,
                 c, sums[o].values[c], o + 1 < outputs ? sums[o + 1].values[c] : unused);
  }
}

}  // namespace fastibl
