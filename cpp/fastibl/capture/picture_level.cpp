#include "fastibl/capture/picture_level.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace fastibl {
namespace {

constexpr int kRounds = 3;              // of choosing the probes that an exposure should show
constexpr float kShown = 0.8f;          // of white: brighter parts may hold a clipped pixel
constexpr double kMedianLoss = 1.2533;  // deviation of a median over that of a mean
constexpr double kNormal = 1.4826;      // standard deviation over median absolute deviation
constexpr double kProbesPerDegree = 4;  // neighbours err alike
constexpr double kClearlyShown = 4 * double(kDarkest);
constexpr double kFarOffShare = 0.8;
constexpr double kFar = 50;  // ln of a ratio that stands for infinity

double median(std::vector<double>& values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

float mean(const glm::vec3& v) { return (v.x + v.y + v.z) / 3; }

bool shows(const LevelProbe& p, double exposure) {
  const double linear = exposure * double(mean(p.expected));
  return linear >= 2 * double(kDarkest) && linear <= double(kShown);
}

// ln of linear over expected; ±kFar where the picture only tells the sign.
double log_ratio(const LevelProbe& p, int channel) {
  if (p.clipped) return kFar;
  if (!(p.linear[channel] > kDarkest)) return -kFar;
  return std::log(double(p.linear[channel]) / double(p.expected[channel]));
}

}  // namespace

double PictureLevel::deviation() const {
  return kMedianLoss * spread * std::sqrt(kProbesPerDegree / std::max(1, count));
}

std::optional<PictureLevel> fit_shown(std::span<const LevelProbe> probes) {
  std::vector<double> ratios;
  for (const LevelProbe& p : probes)
    if (!p.clipped && mean(p.linear) > 2 * kDarkest && mean(p.linear) < kShown)
      ratios.push_back(std::log(double(mean(p.linear)) / double(mean(p.expected))));
  if (int(ratios.size()) < kLeastProbes) return std::nullopt;
  PictureLevel level;
  level.count = int(ratios.size());
  const double middle = median(ratios);
  level.exposure = std::exp(middle);
  for (double& r : ratios) r = std::abs(r - middle);
  level.spread = kNormal * median(ratios);
  return level;
}

std::optional<PictureLevel> fit_level(std::span<const LevelProbe> probes) {
  const std::optional<PictureLevel> shown = fit_shown(probes);
  if (!shown) return std::nullopt;
  PictureLevel level{.exposure = shown->exposure};
  std::vector<double> ratios;
  for (int round = 0; round < kRounds; ++round) {
    double middle[3], sum = 0, squares = 0;
    for (int c = 0; c < 3; ++c) {
      ratios.clear();
      for (const LevelProbe& p : probes)
        if (shows(p, level.exposure)) ratios.push_back(log_ratio(p, c));
      if (int(ratios.size()) < kLeastProbes) return std::nullopt;
      level.count = int(ratios.size());
      middle[c] = median(ratios);
      if (std::abs(middle[c]) >= kFar) return std::nullopt;
      for (double& r : ratios) r = std::abs(r - middle[c]);
      const double deviation = kNormal * median(ratios);
      sum += middle[c] / 3, squares += deviation * deviation / 3;
    }
    level.exposure = std::exp(sum);
    for (int c = 0; c < 3; ++c) level.tint[c] = std::exp(middle[c] - sum);
    level.spread = std::sqrt(squares);
  }
  return level;
}

bool is_far_off(std::span<const LevelProbe> probes, double exposure) {
  int off = 0, all = 0;
  for (const LevelProbe& p : probes) {
    const double expected = exposure * double(mean(p.expected)), linear = double(mean(p.linear));
    const bool shown = p.clipped || linear > kClearlyShown;
    if (!shown && !(expected > kClearlyShown)) continue;
    ++all;
    off += p.clipped ? expected < 0.5 * kShown
                     : linear < 0.5 * std::min(expected, double(kShown)) || linear > 2 * expected;
  }
  return all >= kLeastProbes && off >= kFarOffShare * all;
}

}  // namespace fastibl
