#include "fastibl/capture/swept_costs.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

// The interval of kSwept by steps of 0.05.
constexpr std::array<std::size_t, 20> kIntervals = [] {
  std::array<std::size_t, 20> out{};
  for (std::size_t i = 0; i < out.size(); ++i)
    while (SweptCosts::kSwept[out[i] + 1] < 0.05 * (double(i) + 0.5)) ++out[i];
  return out;
}();

}  // namespace

std::size_t SweptCosts::place(const glm::dvec3& d) {
  const double size = std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
  const auto cell = [&](double v) {
    return std::clamp(int((v / size + 1) * kAcross / 2), 0, kAcross - 1);
  };
  return std::size_t(cell(d.x + d.y)) * kAcross + std::size_t(cell(d.x - d.y));
}

void SweptCosts::add(std::size_t k, const glm::dvec3& direction, double cost) {
  if (!(direction.z > 0)) return;
  Sum& sum = sums_[place(direction)][k];
  sum.cost += cost, ++sum.count;
}

bool SweptCosts::enough(const glm::dvec3& direction) const {
  return direction.z > 0 && sums_[place(direction)][kUsual].count >= kEnough;
}

double SweptCosts::Part::at(double inverse_distance) const {
  const double x = std::clamp(inverse_distance, 0.0, kSwept.back());
  const std::size_t k = kIntervals[std::min(std::size_t(20 * x), kIntervals.size() - 1)];
  const double part = (x - kSwept[k]) / (kSwept[k + 1] - kSwept[k]);
  return cost[k] + part * (cost[k + 1] - cost[k]);
}

std::vector<SweptCosts::Part> SweptCosts::parts() const {
  std::vector<Part> out;
  for (std::size_t i = 0; i < sums_.size(); ++i) {
    double cost = 0, count = 0;
    for (const Sum& sum : sums_[i]) cost += sum.cost, count += sum.count;
    if (count == 0) continue;
    const double s = (double(i / kAcross) + 0.5) * 2 / kAcross - 1,
                 t = (double(i % kAcross) + 0.5) * 2 / kAcross - 1;
    const double u = 0.5 * (s + t), v = 0.5 * (s - t);
    Part& part = out.emplace_back();
    part.direction = glm::normalize(glm::dvec3(u, v, 1 - std::abs(u) - std::abs(v)));
    part.weight = count / double(kSwept.size());
    // A distance that no point was seen at is neither better nor worse than the others.
    for (std::size_t k = 0; k < kSwept.size(); ++k) {
      const Sum& sum = sums_[i][k];
      part.cost[k] = part.weight * (sum.count > 0 ? sum.cost / sum.count : cost / count);
    }
  }
  return out;
}

}  // namespace fastibl
