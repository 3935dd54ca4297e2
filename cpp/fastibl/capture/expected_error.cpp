#include "fastibl/capture/expected_error.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kLeast = 0.001;  // of a map that was seen all over: registration, footprints
// Of the error that near things may cause beyond what is expected of them: in the upper end alone.
constexpr double kDoubts = 0.8;

// Of the light of a plane of which little was seen: an albedo of 0.5 is assumed, or what a sliver
// shows stands for all of it. At worst, a dark sliver stands for a bright table.
constexpr double kGuessed = 0.4, kGuessedMost = 1;

// Spread of clipping lights above which they count as places apart.
constexpr double kApart = 0.1;

// An error, and how far below and above it the truth may lie: the spread of its logarithm.
struct Unseen {
  double expected, below, above;
};

// The error by what was never seen. The less is unseen, the more it matters what that is.
Unseen by_unseen(const MapKnowledge& known) {
  const double sky = std::clamp(known.unseen_sky, 0.0, 1.0);
  const double flux = std::clamp(known.unseen_flux, 0.0, 1.0);
  if (known.metered)
    return {0.36 * std::sqrt(sky + 0.01) * std::pow(flux + 0.01, 1.7), 1 - 0.4 * sky,
            0.75 - 0.45 * sky};
  // Nothing tells how bright the rest of the sky is.
  return {0.22 * std::pow(sky + 0.01, 1.3) + 0.36 * std::pow(flux, 2.6), 2 - 0.9 * sky,
          1.3 - 0.75 * sky};
}

struct Bounds {
  double expected, low, high;
};

// The error by what is only a bound, and its ends. above: the spread of the whole.
Bounds by_bounds(const MapKnowledge& known, double above) {
  if (!known.metered) {
    const double share = known.bound_flux;
    return {0.8 * share, 0.1 * share, 1.4 * share};
  }
  // What may be shown unclipped yet. A light that clips may be a small share of what is known, and
  // most of the light.
  const double open = std::max(known.bound_flux - known.weighed_flux, 0.0),
               most = 0.5 * open * std::exp(above) + 0.3 * std::sqrt(std::max(open - 0.001, 0.0));
  // What was made as bright as the plane's light says. One reading does not tell where the light
  // comes from, which does not matter for a sun.
  const double apart = std::min(known.weighed_spread / kApart, 1.0),
               spread = apart *
                        (0.2 * known.weighed_flux + 0.25 * known.boosted_flux * known.boosted_flux),
               sun = (1 - apart) * known.boosted_flux;
  return {0.5 * open + spread + 0.06 * sun, 0.3 * spread,
          std::max(most + 2.5 * spread + 0.1 * sun, 0.3 * known.bound_doubt)};
}

}  // namespace

ErrorInterval expected_error(const MapKnowledge& known) {
  if (known.unseen_flux >= 1) return {};  // nothing was seen: nothing is known
  const Unseen unseen = by_unseen(known);
  const Bounds bounds = by_bounds(known, unseen.above);
  // What is only a bound, or near, may be wrong by that much, or not at all.
  const double sure = unseen.expected + kLeast, near = sure + known.parallax + known.scale,
               open = near + kGuessed * known.guessed_plane,
               most = near + kGuessedMost * known.guessed_plane;
  return {open + bounds.expected, sure * std::exp(-unseen.below) + bounds.low,
          most * std::exp(unseen.above) + bounds.high + kDoubts * known.parallax_doubt};
}

}  // namespace fastibl
