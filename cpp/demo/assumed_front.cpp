#include "demo/assumed_front.h"

#include <cmath>

#include "fastibl/lighting/harmonic_sums.h"

namespace fastibl::demo {
namespace {

constexpr double kMostUnseen = 0.6;  // of the sky: with more the white says little of what was seen
constexpr int kFrames = 30;          // with a map before it is asked
constexpr double kGood = 0.15;       // of a factor's logarithm: no better than the albedo is known
constexpr int kRounds = 2;           // a map in the wrong scale fills what is unseen wrongly, too
constexpr int kTexels = 32;          // along an edge of the level that is summed

}  // namespace

void AssumedFront::fill(Frame& frame) {
  if (frame.front.data == nullptr || frame.front_exposure) return;
  untold_ = true;
  frame.front_exposure = exposure_;
}

std::optional<double> AssumedFront::measure(const Environment* environment) {
  if (!untold_ || rounds_ >= kRounds || !environment) return std::nullopt;
  if (++frames_ < kFrames || environment->knowledge.unseen_sky > kMostUnseen ||
      !environment->plane_irradiance)
    return std::nullopt;
  const glm::dvec3 light = plane_irradiance(fold(environment->radiance, kTexels)),
                   white = *environment->plane_irradiance;
  double factor = 0;
  for (int c = 0; c < 3; ++c) factor += light[c] / white[c] / 3;
  if (!(factor > 0) || !std::isfinite(factor)) return std::nullopt;
  frames_ = 0, ++rounds_;
  if (std::abs(std::log(factor)) <= kGood) {
    rounds_ = kRounds;
    return std::nullopt;
  }
  exposure_ *= factor;
  return exposure_;
}

}  // namespace fastibl::demo
