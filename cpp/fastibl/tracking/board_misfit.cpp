#include "fastibl/tracking/board_misfit.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr int kAcross = 4;         // parts along each side of what is seen
constexpr int kFewest = 16;        // edges of a part
constexpr double kBothWays = 0.2;  // of 1 where they tell of both directions alike
constexpr double kUsual = 1.6;     // deviations that parts lie beside their places without a misfit
constexpr double kParameters = 6;  // of what the parts tell: taken up by the pose

// How far a part lies beside its place: normal equations of a shift in the picture.
struct Part {
  double xx = 0, xy = 0, yy = 0, x = 0, y = 0;
  int count = 0;

  void add(const EdgePoint& p, double left, double deviation) {
    const double w = 1 / (deviation * deviation);
    xx += w * p.normal.x * p.normal.x, xy += w * p.normal.x * p.normal.y;
    yy += w * p.normal.y * p.normal.y;
    x += w * p.normal.x * left, y += w * p.normal.y * left;
    ++count;
  }
};

}  // namespace

double board_misfit(std::span<const EdgePoint> points, const EdgeFit& fit, double variance) {
  const auto [low, high] = UsedRange(points, fit);
  std::array<Part, kAcross * kAcross> parts{};
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!fit.used[i]) continue;
    const glm::dvec2 at = double(kAcross) * (points[i].point - low) / (high - low);
    const int column = std::clamp(int(at.x), 0, kAcross - 1),
              row = std::clamp(int(at.y), 0, kAcross - 1);
    parts[std::size_t(kAcross * row + column)].add(points[i], fit.left[i], fit.deviation[i]);
  }
  // Squares of the parts' shifts, and what is to be expected of them from scatter alone; what edges
  // share, above all blur from their neighbours, comes on top of it.
  double squares = 0, expected = 0, told = 0;
  for (const Part& p : parts) {
    const double det = p.xx * p.yy - p.xy * p.xy;
    const double mean = 0.5 * (p.xx + p.yy);
    if (p.count < kFewest || !(det > kBothWays * mean * mean)) continue;
    const double x = (p.yy * p.x - p.xy * p.y) / det, y = (p.xx * p.y - p.xy * p.x) / det;
    squares += x * x + y * y, expected += (p.xx + p.yy) / det, told += 2;
  }
  if (!(told > kParameters)) return 0;
  const double left = told - kParameters;
  const double excess = squares / left - kUsual * kUsual * variance * expected / told;
  return excess > 0 ? std::sqrt(excess) : 0;
}

}  // namespace fastibl
