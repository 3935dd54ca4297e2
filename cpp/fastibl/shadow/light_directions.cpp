#include "fastibl/shadow/light_directions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

// Whether a part spans a larger angle along x than along y. With a and b the position on the face
// of the unit cube, p = (a, b, 1): |∂(p/|p|)/∂a| = √(1 + b²)/(1 + a² + b²).
bool is_wide(const SkyRect& r, double size) {
  const double a = (r.x0 + r.x1) / size - 1, b = (r.y0 + r.y1) / size - 1;
  const double along_x = (r.x1 - r.x0) * (r.x1 - r.x0) * (1 + b * b);
  const double along_y = (r.y1 - r.y0) * (r.y1 - r.y0) * (1 + a * a);
  return along_x >= along_y;
}

void split(const SkyEnergy& sky, const SkyRect& rect, double weight, int count,
           std::vector<SkyRect>& out) {
  if (count <= 1) {
    out.push_back(rect);
    return;
  }
  const int first_count = count / 2;
  const double first_weight = weight * first_count / count;
  SkyRect first = rect, second = rect;
  if (is_wide(rect, sky.size()))
    first.x1 = second.x0 = sky.split_x(rect, first_weight);
  else
    first.y1 = second.y0 = sky.split_y(rect, first_weight);
  split(sky, first, first_weight, first_count, out);
  split(sky, second, weight - first_weight, count - first_count, out);
}

// How many directions each face gets: in proportion to its weight, at least one if it has any.
std::array<int, kSkyFaces> counts_of(const std::array<double, kSkyFaces>& weights, int count) {
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  std::array<int, kSkyFaces> counts{};
  int given = 0;
  for (int f = 0; f < kSkyFaces; ++f) {
    const double share = weights[std::size_t(f)] / total;
    counts[std::size_t(f)] = share > 1e-9 ? std::max(int(share * count), 1) : 0;
    given += counts[std::size_t(f)];
  }
  // The rest to where a direction stands for the most; too many are taken where for the least.
  for (; given != count; given += given < count ? 1 : -1) {
    int best = -1;
    double best_value = 0;
    for (int f = 0; f < kSkyFaces; ++f) {
      const std::size_t i = std::size_t(f);
      if (counts[i] == 0 || (given > count && counts[i] == 1)) continue;
      const double value =
          given < count ? weights[i] / counts[i] : counts[i] / std::max(weights[i], 1e-300);
      if (best < 0 || value > best_value) best = f, best_value = value;
    }
    counts[std::size_t(best)] += given < count ? 1 : -1;
  }
  return counts;
}

}  // namespace

std::vector<SkyRect> split_sky(const SkyEnergy& sky, int count) {
  check(count >= kLeastDirections && count <= kMostDirections, "directions must be from ",
        kLeastDirections, " to ", kMostDirections, ", got ", count);
  std::vector<SkyRect> parts;
  if (sky.no_light()) return parts;
  std::array<double, kSkyFaces> weights;
  for (int f = 0; f < kSkyFaces; ++f) weights[std::size_t(f)] = sky.weight(sky.face(f));
  const std::array<int, kSkyFaces> counts = counts_of(weights, count);
  for (int f = 0; f < kSkyFaces; ++f)
    if (counts[std::size_t(f)] > 0)
      split(sky, sky.face(f), weights[std::size_t(f)], counts[std::size_t(f)], parts);
  return parts;
}

std::vector<LightDirection> light_directions(const SkyEnergy& sky, std::span<const SkyRect> parts) {
  std::vector<LightDirection> directions;
  directions.reserve(parts.size());
  glm::dvec3 total(0);
  std::vector<glm::dvec3> shares;
  for (const SkyRect& part : parts) {
    directions.push_back({sky.direction(part), glm::vec3(0)});
    shares.push_back(sky.share(part));
    total += shares.back();
  }
  // Faces with next to no light have no part.
  for (std::size_t i = 0; i < shares.size(); ++i)
    for (int c = 0; c < 3; ++c)
      directions[i].share[c] = total[c] > 0 ? float(shares[i][c] / total[c]) : 0;
  return directions;
}

std::vector<LightDirection> light_directions(const CubeMap& radiance, int count) {
  check(radiance.size() > 0, "the radiance map is empty");
  const SkyEnergy sky(radiance.level_at_most(kDirectionLevel));
  return light_directions(sky, split_sky(sky, count));
}

std::vector<glm::ivec4> whole_shares(std::span<const LightDirection> directions) {
  glm::dvec3 total(0), before(0);
  for (const LightDirection& d : directions) total += glm::dvec3(d.share);
  std::vector<glm::ivec4> shares(directions.size(), glm::ivec4(0));
  // Differences of the rounded sums: no rest is left over.
  for (std::size_t i = 0; i < directions.size(); ++i)
    for (int c = 0; c < 3; ++c) {
      if (!(total[c] > 0)) continue;
      const double after =
          i + 1 == directions.size() ? total[c] : before[c] + directions[i].share[c];
      const auto whole = [&](double x) {
        return std::int64_t(std::min(x / total[c], 1.0) * kWholeShare + 0.5);
      };
      shares[i][c] = int(whole(after) - whole(before[c]));
      before[c] = after;
    }
  return shares;
}

}  // namespace fastibl
