#include "fastibl/shadow/outline_weights.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace fastibl {

std::vector<float> outline_weights(const std::vector<SurfacePoint>& points) {
  constexpr int kViews = 48;
  glm::vec3 lower(points[0].position), upper(lower);
  for (const SurfacePoint& p : points)
    lower = glm::min(lower, p.position), upper = glm::max(upper, p.position);
  const glm::vec3 centre = 0.5f * (lower + upper);
  const float reach = 0.5f * glm::length(upper - lower) + 4;
  const int size = 2 * int(std::ceil(reach));
  std::vector<double> sums(points.size(), 0);
  std::vector<std::uint8_t> covered(std::size_t(size * size));
  std::vector<float> shares(covered.size()), parts(points.size());
  std::vector<int> pixels(points.size());
  for (int view = 0; view < kViews; ++view) {
    // Half a sphere is enough: outlines from the back are the same.
    const float z = 1 - (float(view) + 0.5f) / float(kViews), r = std::sqrt(1 - z * z),
                turn = float(view) * kPi * (3 - std::sqrt(5.0f));
    const glm::vec3 d(r * std::cos(turn), r * std::sin(turn), z);
    const glm::vec3 t = glm::normalize(
        glm::cross(d, std::abs(d.x) < 0.7f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0)));
    const glm::vec3 b = glm::cross(d, t);
    std::fill(covered.begin(), covered.end(), std::uint8_t(0));
    std::fill(shares.begin(), shares.end(), 0.0f);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const glm::vec3 p = points[i].position - centre;
      const float x = glm::dot(p, t) + reach, y = glm::dot(p, b) + reach;
      pixels[i] = int(y) * size + int(x);
      const int corner = int(y - 0.5f) * size + int(x - 0.5f);  // of the four nearest pixels
      for (const int k : {0, 1, size, size + 1}) covered[std::size_t(corner + k)] = 1;
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
      bool outline = false;
      for (const int k : {2, -2, 2 * size, -2 * size, size + 1, size - 1, -size + 1, -size - 1})
        outline |= !covered[std::size_t(pixels[i] + k)];
      const float slope = glm::dot(points[i].normal, d);
      parts[i] = outline ? points[i].area * (1.02f - slope * slope) : 0.0f;
      shares[std::size_t(pixels[i])] += parts[i];
    }
    for (std::size_t i = 0; i < points.size(); ++i)
      if (parts[i] > 0) sums[i] += double(parts[i] / shares[std::size_t(pixels[i])]);
  }
  double total = 0, area = 0;
  const auto plain = [](const SurfacePoint& p) { return double(p.area / (1 + p.thickness)); };
  for (std::size_t i = 0; i < points.size(); ++i) total += sums[i], area += plain(points[i]);
  std::vector<float> weights(points.size());
  constexpr double kEvery = 0.12;  // share of the weight that goes by area
  for (std::size_t i = 0; i < points.size(); ++i)
    weights[i] = float(double(points.size()) * ((1 - kEvery) * sums[i] / std::max(total, 1e-12) +
                                                kEvery * plain(points[i]) / area));
  return weights;
}

}  // namespace fastibl
