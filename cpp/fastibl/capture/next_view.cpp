#include "fastibl/capture/next_view.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace fastibl {
namespace {

constexpr int kGrid = 16;               // texels along an edge of a face, for choosing
constexpr double kView = 28 * kDegree;  // from the middle of a picture to what it surely shows
constexpr double kNear = 90 * kDegree;  // a turn by this much more must show e times as much
constexpr double kWorth = 1e-3;         // share of the light below which nothing is worth a turn

struct SkyTexel {
  int face, x, y;
  glm::dvec3 direction;
  double angle;
};

std::vector<SkyTexel> sky_of(int size) {
  std::vector<SkyTexel> sky;
  for (int f = 0; f < 6; ++f)
    for (int k = 0; k < size * size; ++k) {
      const int x = k % size, y = k / size;
      const glm::dvec3 d = glm::normalize(glm::dvec3(texel_direction(f, x, y, size)));
      if (d.z > 0) sky.push_back({f, x, y, d, texel_solid_angle(x, y, size)});
    }
  return sky;
}

// Share of a coarse texel that was seen.
double seen_share(const std::vector<float>& confidence, int size, int coarse, const SkyTexel& t) {
  const auto row = [&](int y) { return (std::size_t(t.face * size) + std::size_t(y)) * size; };
  int seen = 0, count = 0;
  for (int y = t.y * size / coarse; y < (t.y + 1) * size / coarse; ++y)
    for (int x = t.x * size / coarse; x < (t.x + 1) * size / coarse; ++x, ++count)
      seen += confidence[row(y) + std::size_t(x)] > 0;
  return double(seen) / count;
}

}  // namespace

NextView next_view(const Environment& environment, const std::optional<glm::dvec3>& looking) {
  environment.validate();
  const CubeMap& map = environment.radiance;
  const CubeLevel& level = map.level_at_most(kGrid);
  const std::vector<SkyTexel> sky = sky_of(level.size());
  const std::vector<float> confidence = environment.confidence();
  std::vector<double> unseen, light;
  double mean = 0;
  NextView next;
  for (const SkyTexel& t : sky) {
    const double seen = seen_share(confidence, map.size(), level.size(), t);
    const glm::dvec3 texel(level.texel(t.face, t.x, t.y));
    unseen.push_back(1 - seen), light.push_back((texel.x + texel.y + texel.z) / 3);
    mean += light.back() / double(sky.size());
    next.seen += seen * t.angle / (2 * std::numbers::pi);
  }
  // The light of unseen parts is a guess: any may hold a lamp, so the mean is added. With a black
  // map only the angle counts.
  const double more = mean > 0 ? mean : 1;
  const double all = 2 * std::numbers::pi * (mean + more);
  double best = 0, most = 0;
  for (const SkyTexel& middle : sky) {
    double gain = 0;
    for (std::size_t k = 0; k < sky.size(); ++k)
      if (unseen[k] > 0 && glm::dot(middle.direction, sky[k].direction) > std::cos(kView))
        gain += unseen[k] * (light[k] + more) * sky[k].angle;
    most = std::max(most, gain);
    double preferred = gain;
    if (looking)
      preferred *=
          std::exp(-std::acos(std::clamp(glm::dot(middle.direction, *looking), -1.0, 1.0)) / kNear);
    if (preferred <= best) continue;
    best = preferred, next.direction = middle.direction, next.share = gain / all;
  }
  if (!(most / all > kWorth)) next.direction.reset(), next.share = 0;
  return next;
}

}  // namespace fastibl
