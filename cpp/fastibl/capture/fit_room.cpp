#include "fastibl/capture/fit_room.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

namespace fastibl {
namespace {

constexpr int kYaws = 6;  // within the quarter turn after which walls change places
constexpr std::size_t kStarts = 2;
constexpr int kValues = 17;
constexpr double kNearest = 3, kFarthest = 0.4;  // of the usual inverse distance
// Walls are farther than a sphere through them on the whole, and what is in their middle nearer:
// where they are thought to be, and how much a doubt of it by a factor e costs.
constexpr double kLikely = 1.2, kDoubt = 0.6;
constexpr double kFirstTurn = 4 * kDegree, kFirstStep = 0.06, kLastStep = 0.004;

// 1 / distance from the centre of the walls at +x, −x, +y, −y, along their own axes, and above.
struct Walls {
  double yaw = 0;
  std::array<double, 5> nearness{};
};

// The parts' directions along the walls of a yaw: what each wall's nearness is multiplied by.
using Slopes = std::array<double, 5>;
Slopes slopes(const glm::dvec3& direction, const glm::dvec2& axis) {
  const glm::dvec3 d = along_walls(direction, axis);
  return {d.x, -d.x, d.y, -d.y, d.z};
}

double doubt(double nearness, double usual) {
  const double off = std::log(nearness / (kLikely * usual));
  return kDoubt * off * off;
}

double cost(std::span<const SweptCosts::Part> parts, const Walls& walls, double usual) {
  double sum = 0;
  const glm::dvec2 axis = RoomBox{.yaw = walls.yaw}.axis();
  for (const SweptCosts::Part& part : parts) {
    const Slopes slope = slopes(part.direction, axis);
    double nearness = 0;
    for (std::size_t i = 0; i < slope.size(); ++i)
      nearness = std::max(nearness, walls.nearness[i] * slope[i]);
    sum += part.at(nearness);
  }
  for (const double w : walls.nearness) sum += doubt(w, usual);
  return sum;
}

// One wall after the other, the ceiling first, each among kValues places.
Walls coarse(std::span<const SweptCosts::Part> parts, double yaw, double usual) {
  Walls walls{yaw, {}};
  walls.nearness.fill(kLikely * usual);
  std::vector<Slopes> slope;
  const glm::dvec2 axis = RoomBox{.yaw = yaw}.axis();
  for (const SweptCosts::Part& part : parts) slope.push_back(slopes(part.direction, axis));
  std::vector<double> others(parts.size());
  for (const std::size_t wall : {4u, 0u, 1u, 2u, 3u}) {
    for (std::size_t p = 0; p < parts.size(); ++p) {
      others[p] = 0;
      for (std::size_t i = 0; i < walls.nearness.size(); ++i)
        if (i != wall) others[p] = std::max(others[p], walls.nearness[i] * slope[p][i]);
    }
    double least = 0;
    for (int k = 0; k < kValues; ++k) {
      const double value =
          usual * kFarthest * std::pow(kNearest / kFarthest, double(k) / (kValues - 1));
      double sum = doubt(value, usual);
      for (std::size_t p = 0; p < parts.size(); ++p)
        sum += parts[p].at(std::max(others[p], value * slope[p][wall]));
      if (k == 0 || sum < least) least = sum, walls.nearness[wall] = value;
    }
  }
  return walls;
}

// Steps in one parameter at a time, halved where none helps. Returns the cost.
double refine(std::span<const SweptCosts::Part> parts, double usual, Walls& walls) {
  double least = cost(parts, walls, usual);
  for (double step = kFirstStep; step > kLastStep;) {
    bool moved = false;
    for (std::size_t parameter = 0; parameter <= walls.nearness.size(); ++parameter)
      for (const double sign : {1.0, -1.0}) {
        Walls next = walls;
        if (parameter == 0)
          next.yaw += sign * step * (kFirstTurn / kFirstStep);
        else
          next.nearness[parameter - 1] *= std::exp(sign * step);
        const double value = cost(parts, next, usual);
        if (!(value < least)) continue;
        walls = next, least = value, moved = true;
        break;
      }
    if (!moved) step /= 2;
  }
  return least;
}

Walls walls_of(const RoomBox& box, const glm::dvec3& centre) {
  const glm::dvec3 at = along_walls(centre, box.axis());
  return {box.yaw,
          {1 / (box.upper.x - at.x), 1 / (at.x - box.lower.x), 1 / (box.upper.y - at.y),
           1 / (at.y - box.lower.y), 1 / (box.upper.z - at.z)}};
}

RoomBox box_of(const Walls& walls, const glm::dvec3& centre) {
  RoomBox box;
  box.yaw = walls.yaw;
  const glm::dvec3 at = along_walls(centre, box.axis());
  const auto& w = walls.nearness;
  box.upper = at + glm::dvec3(1 / w[0], 1 / w[2], 1 / w[4]);
  box.lower = glm::dvec3(at.x - 1 / w[1], at.y - 1 / w[3], 0);
  return box;
}

}  // namespace

RoomBox fit_room(std::span<const SweptCosts::Part> parts, const glm::dvec3& centre, double usual,
                 const std::optional<RoomBox>& from, bool everywhere) {
  std::vector<std::pair<double, Walls>> starts;
  for (int k = 0; (everywhere || !from) && k < kYaws; ++k) {
    const Walls walls = coarse(parts, 90 * kDegree * k / kYaws, usual);
    starts.emplace_back(cost(parts, walls, usual), walls);
  }
  std::stable_sort(starts.begin(), starts.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  if (starts.size() > kStarts) starts.resize(kStarts);
  if (from) starts.emplace_back(0, walls_of(*from, centre));
  for (auto& [value, walls] : starts) value = refine(parts, usual, walls);
  const auto best = std::min_element(
      starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return box_of(best->second, centre);
}

}  // namespace fastibl
