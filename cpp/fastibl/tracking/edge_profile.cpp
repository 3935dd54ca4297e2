#include "fastibl/tracking/edge_profile.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kLeastContrast = 0.25;  // of white; shadows, glare and ink leave smaller steps
constexpr double kLeastStep = 2e-3;      // of full white

// Mean of the scan lines that cross a stretch of edge, at whole pixels from it, smoothed across by
// a cubic B-spline: its samples on the pixel grid add up to 1 wherever the edge lies, and its
// spectrum is nil at the grid's frequency, so that the position between pixels leaves no trace.
struct Profile {
  std::array<float, 2 * kMostReach + 1> value{};  // black first; the edge at `reach`
  int reach = 0, lines = 0;
  float phase = 0;   // as in NearEdge
  double scale = 1;  // px across the edge per px along a scan line
};

// With the numbers of channels and pixels known, its loops are unrolled.
template <int Channels, int Reach>
bool read_profile(const LightReader& light, const ExpectedEdge& e, Profile& profile) {
  const glm::dvec2 d = e.b - e.a;
  const bool steep = std::abs(d.y) >= std::abs(d.x);  // scan lines are rows
  const int along = steep ? 1 : 0, across = 1 - along;
  const double length = glm::length(d);
  if (!(length > 0)) return false;
  const double from = std::min(e.a[along], e.b[along]), to = std::max(e.a[along], e.b[along]);
  const int first = int(std::ceil(from - 0.5)), last = int(std::ceil(to - 0.5));
  const double slope = d[across] / d[along];
  const int size = steep ? light.width() : light.height(),
            lines = steep ? light.height() : light.width();
  if (first < 0 || last > lines) return false;
  profile.reach = Reach, profile.lines = 0, profile.phase = 0;
  constexpr int n = 2 * Reach + 1;
  float sum[n] = {}, line[n + 3];
  for (int k = first; k < last; ++k) {
    const double at = e.a[across] + (k + 0.5 - e.a[along]) * slope - 0.5;
    if (!(at >= Reach + 1)) return false;
    const int i = int(at), begin = i - Reach - 1;
    if (begin + n + 3 > size) return false;
    const float f = float(at - i), g = 1 - f;
    const float b0 = g * g * g / 6, b3 = f * f * f / 6, b1 = (4 - 6 * f * f + 3 * f * f * f) / 6,
                b2 = 1 - b0 - b1 - b3;
    light.read<Channels, n + 3>(steep ? begin : k, steep ? k : begin, !steep, line);
    for (int j = 0; j < n; ++j)
      sum[j] += b0 * line[j] + b1 * line[j + 1] + b2 * line[j + 2] + b3 * line[j + 3];
    profile.phase += 16 * (0.5f - f) * (0.5f - std::abs(0.5f - f));  // sin 2πf, within 6 %
    ++profile.lines;
  }
  if (profile.lines == 0) return false;
  // White on the left of (dx, dy): towards (dy, −dx).
  const bool rising = steep ? d.y > 0 : d.x < 0;
  for (int j = 0; j < n; ++j)
    profile.value[std::size_t(j)] = sum[rising ? j : n - 1 - j] / float(profile.lines);
  profile.phase *= (rising ? 1.0f : -1.0f) / float(profile.lines);
  profile.scale = std::abs(d[along]) / length;
  return true;
}

template <int Channels>
bool read_profile_of(const LightReader& light, const ExpectedEdge& e, Profile& profile) {
  switch (std::clamp(e.reach, 1, kMostReach)) {
    case 1:
      return read_profile<Channels, 1>(light, e, profile);
    case 2:
      return read_profile<Channels, 2>(light, e, profile);
    case 3:
      return read_profile<Channels, 3>(light, e, profile);
    case 4:
      return read_profile<Channels, 4>(light, e, profile);
    case 5:
      return read_profile<Channels, 5>(light, e, profile);
    default:
      return read_profile<Channels, kMostReach>(light, e, profile);
  }
}

bool read_profile(const LightReader& light, const ExpectedEdge& e, Profile& profile) {
  return light.channels() == 1 ? read_profile_of<1>(light, e, profile)
                               : read_profile_of<3>(light, e, profile);
}

bool clear(double black, double white) {
  return white - black > kLeastContrast * white && white - black > kLeastStep;
}

// Shot noise grows with the light, and there is some noise without any light.
double noise_variance(double black, double white) { return 0.5 * (black + white) + 0.02; }

}  // namespace

std::optional<FarEdge> find_far_edge(const LightReader& light, const ExpectedEdge& expected) {
  Profile p;
  if (!read_profile(light, expected, p)) return std::nullopt;
  const int reach = p.reach, n = 2 * reach + 1, level = reach >= 4 ? 2 : 1;
  double black = 0, white = 0, area = 0;
  for (int k = 0; k < level; ++k)
    black += p.value[std::size_t(k)], white += p.value[std::size_t(n - 1 - k)];
  black /= level, white /= level;
  if (!clear(black, white)) return std::nullopt;
  for (int k = 0; k < n; ++k)  // trapezium
    area += (k == 0 || k == n - 1 ? 0.5 : 1.0) * p.value[std::size_t(k)];
  const double offset = reach - (area - (n - 1) * black) / (white - black);
  if (std::abs(offset) > 0.8 * reach) return std::nullopt;
  const double step = white - black;
  const int middle = std::clamp(reach + int(std::lround(offset)), 1, n - 2);
  const double slope = 0.5 * (p.value[std::size_t(middle + 1)] - p.value[std::size_t(middle - 1)]);
  return FarEdge{offset * p.scale,
                 std::sqrt(noise_variance(black, white) / p.lines) * p.scale / step,
                 slope / (step * p.scale)};
}

std::optional<NearEdge> find_near_edge(const LightReader& light, const ExpectedEdge& expected) {
  const int levels = std::min(expected.reach, kMostReach - 1), nearest = std::min(levels, 2);
  Profile p;
  if (!read_profile(light, {expected.a, expected.b, levels + 1}, p)) return std::nullopt;
  const auto at = [&](int k) { return double(p.value[std::size_t(p.reach + k)]); };
  const auto slope = [&](int k) { return 0.5 * (at(k + 1) - at(k - 1)); };
  // The edge is where the profile crosses the middle between black and white. A wide edge reaches
  // the samples that tell black and white, so that they change, too, when it moves: `gain` is the
  // profile's slope less theirs, by which the distance from the crossing is worked out.
  double black = 0, white = 0, gain = 0;
  for (int k = nearest; k <= levels; ++k) {
    black += at(-k), white += at(k);
    gain += 0.5 * (slope(k) + slope(-k));
  }
  // A difference of fourth order, as two samples span much of a sharp edge.
  const double steepest = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / 12;
  const int count = levels - nearest + 1;
  black /= count, white /= count, gain = steepest - gain / count;
  if (!clear(black, white)) return std::nullopt;
  const double step = white - black;
  return NearEdge{(0.5 * (black + white) - at(0)) / step, gain / (step * p.scale),
                  std::sqrt(noise_variance(black, white) / p.lines) / step, p.phase};
}

}  // namespace fastibl
