#include "demo/guidance.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace fastibl::demo {
namespace {

constexpr int kGrid = 16;  // texels along an edge of a face, for choosing
constexpr double kDegree = std::numbers::pi / 180;
constexpr double kView = 28 * kDegree;  // from the middle of a picture to what it surely shows
constexpr double kNear = 90 * kDegree;  // a turn by this much more must show e times as much
constexpr double kWorth = 1e-3;         // share of the light below which nothing is worth a turn

struct SkyTexel {
  int face, x, y;
  glm::vec3 direction;
  double angle;
};

std::vector<SkyTexel> sky_of(int size) {
  std::vector<SkyTexel> sky;
  for (int f = 0; f < 6; ++f)
    for (int k = 0; k < size * size; ++k) {
      const int x = k % size, y = k / size;
      const glm::vec3 d = glm::normalize(texel_direction(f, x, y, size));
      if (d.z > 0) sky.push_back({f, x, y, d, texel_solid_angle(x, y, size)});
    }
  return sky;
}

// Share of a coarse texel that was seen.
double seen_share(const std::vector<float>& confidence, int size, int coarse, const SkyTexel& t) {
  const int step = size / coarse;
  int seen = 0;
  for (int y = t.y * step; y < (t.y + 1) * step; ++y)
    for (int x = t.x * step; x < (t.x + 1) * step; ++x)
      seen += confidence[(std::size_t(t.face) * std::size_t(size) + std::size_t(y)) *
                             std::size_t(size) +
                         std::size_t(x)] > 0;
  return double(seen) / (step * step);
}

}  // namespace

Guidance guide(const Environment& environment, const std::optional<Pose>& camera_from_marker) {
  const CubeMap& map = environment.radiance;
  const CubeLevel& level = map.level_at_most(kGrid);
  const std::vector<SkyTexel> sky = sky_of(level.size());
  const std::vector<float> confidence = environment.confidence();
  std::vector<double> unseen, light;
  double mean = 0;
  Guidance guidance;
  for (const SkyTexel& t : sky) {
    const double seen = seen_share(confidence, map.size(), level.size(), t);
    const glm::vec3 texel = level.texel(t.face, t.x, t.y);
    unseen.push_back(1 - seen), light.push_back((texel.x + texel.y + texel.z) / 3);
    mean += light.back() / double(sky.size());
    guidance.seen += seen * t.angle / (2 * std::numbers::pi);
  }
  // What the light of unseen parts is, is a guess: any may hold a lamp, so the mean is added.
  double best = 0, most = 0;
  for (const SkyTexel& middle : sky) {
    double gain = 0;
    for (std::size_t k = 0; k < sky.size(); ++k)
      if (unseen[k] > 0 && glm::dot(middle.direction, sky[k].direction) > std::cos(kView))
        gain += unseen[k] * (light[k] + mean) * sky[k].angle;
    most = std::max(most, gain);
    double preferred = gain;
    if (camera_from_marker) {
      const double z = (camera_from_marker->rotation * glm::dvec3(middle.direction)).z;
      preferred *= std::exp(-std::acos(std::clamp(z, -1.0, 1.0)) / kNear);
    }
    if (preferred <= best) continue;
    best = preferred, guidance.direction = middle.direction;
    guidance.share = gain / (2 * std::numbers::pi * 2 * mean);
  }
  if (!(most / (2 * std::numbers::pi * 2 * mean) > kWorth)) guidance.direction.reset();
  return guidance;
}

std::string way(const glm::vec3& direction, const Pose& camera_from_marker) {
  const glm::dvec3 d = camera_from_marker.rotation * glm::dvec3(direction);
  const double right = std::atan2(d.x, d.z) / kDegree;
  const double up = std::atan2(-d.y, std::hypot(d.x, d.z)) / kDegree;
  std::string text;
  const auto add = [&](double by, const char* plus, const char* minus) {
    if (std::abs(by) < 5) return;
    text += (text.empty() ? "turn " : ", ") + std::to_string(std::lround(std::abs(by))) + " deg " +
            (by > 0 ? plus : minus);
  };
  add(right, "right", "left"), add(up, "up", "down");
  return text.empty() ? "hold still" : text;
}

}  // namespace fastibl::demo
