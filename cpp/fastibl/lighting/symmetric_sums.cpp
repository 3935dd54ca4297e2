// Compiled with contraction into fused multiply-adds (CMakeLists.txt), which doubles the speed.
#include "fastibl/lighting/symmetric_sums.h"

#include <algorithm>

#include "fastibl/core/lanes.h"
#include "fastibl/core/simd.h"

namespace fastibl {
namespace {

constexpr int kPart = 64;  // texels whose values of one channel stay in the first-level cache

// One part, for one channel and two outputs: six wide sums stay in registers.
FASTIBL_CLONES void add_part(const SymmetricTexel* texels, const std::uint32_t* slots,
                                  const float* weights, int count, int channel, float* first,
                                  float* second) {
  Lanes a0{}, a1{}, a2{}, b0{}, b1{}, b2{};
  for (int i = 0; i < count; ++i) {
    const Lanes* v = reinterpret_cast<const Lanes*>(texels[slots[i]].values[channel]);
    const Lanes v0 = v[0], v1 = v[1], v2 = v[2];
    const float a = weights[i * kOutputs], b = weights[i * kOutputs + 1];
    a0 += a * v0, a1 += a * v1, a2 += a * v2;
    b0 += b * v0, b1 += b * v1, b2 += b * v2;
  }
  Lanes* to = reinterpret_cast<Lanes*>(first);
  to[0] += a0, to[1] += a1, to[2] += a2;
  to = reinterpret_cast<Lanes*>(second);
  to[0] += b0, to[1] += b1, to[2] += b2;
}

}  // namespace

void add_symmetric_sums(std::span<const SymmetricTexel> texels,
                        std::span<const std::uint32_t> slots, const float* weights, int outputs,
                        SymmetricTexel* sums) {
  static_assert(kCubeSymmetries * sizeof(float) == 3 * sizeof(Lanes));
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
