#include "fastibl/capture/boost_lights.h"

#include <algorithm>

namespace fastibl {
namespace {

constexpr std::uint8_t kWhole = 7;  // bits of TexelState::bound: all channels

}  // namespace

BoundLight sum_bounds(const TexelState& state, std::size_t first, int count, const float* weights) {
  BoundLight out;
  for (std::size_t k = 0; k < std::size_t(count); ++k) {
    const std::uint8_t bits = state.bound[first + k];
    if (bits == 0) continue;
    glm::dvec3& sum = bits == kWhole ? out.whole : out.part;
    for (int c = 0; c < 3; ++c)
      if (bits >> c & 1) sum[c] += double(weights[k]) * double(state.value[c][first + k]);
  }
  return out;
}

LightBoost boost_of(const BoundLight& light, const glm::dvec3& missing, const glm::dvec3& deviation,
                    double most) {
  LightBoost out;
  for (int c = 0; c < 3; ++c) {
    const double found = missing[c], square = found * found;
    if (!(found > 0)) continue;
    double excess = found * (square / (square + deviation[c] * deviation[c]));
    const auto take = [&](double given) {
      const double factor = given > 0 ? std::min(1 + excess / given, most) : 1;
      excess -= (factor - 1) * given;
      return float(factor);
    };
    out.whole[c] = take(light.whole[c]);
    out.part[c] = take(light.part[c]);
  }
  return out;
}

glm::dvec3 added(const LightBoost& boost, const BoundLight& light) {
  return (glm::dvec3(boost.whole) - 1.0) * light.whole +
         (glm::dvec3(boost.part) - 1.0) * light.part;
}

std::vector<float> boosted(const LightBoost& boost, const TexelState& state, std::size_t first,
                           int count, int stride) {
  std::vector<float> out(3 * std::size_t(stride));
  for (int c = 0; c < 3; ++c) {
    float* to = &out[std::size_t(c) * std::size_t(stride)];
    for (std::size_t k = 0; k < std::size_t(count); ++k) {
      const std::uint8_t bits = state.bound[first + k];
      const float factor = bits >> c & 1 ? (bits == kWhole ? boost.whole[c] : boost.part[c]) : 1.0f;
      to[k] = factor * state.value[c][first + k];
    }
  }
  return out;
}

}  // namespace fastibl
