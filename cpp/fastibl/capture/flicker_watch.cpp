#include "fastibl/capture/flicker_watch.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace fastibl {
namespace {

constexpr double kMemory = 3;          // seconds
constexpr std::size_t kMost = 12;      // pictures of one exposure, at most, that tell its swing
constexpr std::size_t kLeast = 5;      // at least, to tell that it swings
constexpr double kSameExposure = 0.2;  // ln
constexpr double kLeastSwing = 0.03;
constexpr double kDeviations = 3;  // of levels, by which a swing must stand out
// Share of the pictures between which a level passes the mean: a change of the place does so once,
// noise every second time, the mains as the rates make it.
constexpr double kLeastPasses = 0.2;
// Least ratio of the median distance from the mean to the swing: a few wrong exposures are no
// flicker.
constexpr double kLeastMiddle = 0.5;
constexpr double kTowardsMean = 0.3;  // share of the way, per picture

}  // namespace

bool FlickerWatch::watch(double exposure, double log_ratio, double deviation, double time,
                         Levelled& out) {
  std::erase_if(seen_, [&](const Seen& s) { return s.time < time - kMemory; });
  seen_.push_back({exposure, log_ratio, deviation, time});
  std::vector<Seen> same;
  for (std::size_t i = seen_.size(); i-- > 0 && same.size() < kMost;)
    if (std::abs(std::log(seen_[i].exposure / exposure)) < kSameExposure) same.push_back(seen_[i]);
  if (same.size() < kLeast) return false;
  const double count = double(same.size());
  double mean = 0, log_mean = 0, squares = 0, noise = 0;
  for (const Seen& s : same) {
    mean += std::exp(s.log_ratio) / count, log_mean += s.log_ratio / count;
    noise += s.deviation / count;
  }
  int passes = 0;
  std::vector<double> distances;
  for (std::size_t i = 0; i < same.size(); ++i) {
    const double off = same[i].log_ratio - log_mean;
    squares += off * off / count;
    distances.push_back(std::abs(off));
    passes += i > 0 && off * (same[i - 1].log_ratio - log_mean) < 0;
  }
  const double swing = std::sqrt(squares);
  const auto middle = distances.begin() + std::ptrdiff_t(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  if (!(swing > kLeastSwing && swing > kDeviations * noise && *middle > kLeastMiddle * swing) ||
      passes < kLeastPasses * (count - 1))
    return false;
  out = {log_ratio - kTowardsMean * std::log(mean), swing};
  return true;
}

}  // namespace fastibl
