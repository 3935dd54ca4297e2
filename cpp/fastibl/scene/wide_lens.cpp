#include "fastibl/scene/wide_lens.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

using std::numbers::pi;

double bent(double angle, const double (&k)[4]) {
  const double q = angle * angle;
  return angle * (1 + q * (k[0] + q * (k[1] + q * (k[2] + q * k[3]))));
}
double slope(double angle, const double (&k)[4]) {
  const double q = angle * angle;
  return 1 + q * (3 * k[0] + q * (5 * k[1] + q * (7 * k[2] + q * 9 * k[3])));
}

double growth_limit(const double (&k)[4]) {
  constexpr int kSteps = 4000;
  for (int i = 1; i <= kSteps; ++i)
    if (!(slope(i * pi / kSteps, k) > 0)) return (i - 1) * pi / kSteps;
  return pi;
}

}  // namespace

WideLens::WideLens(const Camera& camera)
    : fx_(camera.fx),
      fy_(camera.fy),
      cx_(camera.cx),
      cy_(camera.cy),
      fisheye_(camera.model == CameraModel::fisheye) {
  check(camera.model != CameraModel::perspective, "a perspective camera has a Lens");
  for (std::size_t i = 0; i < std::min<std::size_t>(camera.distortion.size(), 4); ++i)
    k_[i] = camera.distortion[i];
  limit_ = std::min(growth_limit(k_), camera.field_of_view * pi / 360);
}

std::optional<glm::dvec2> WideLens::project(const glm::dvec3& p) const {
  const double across = std::hypot(p.x, p.y), length = std::hypot(across, p.z);
  if (!(length > 0 && std::isfinite(length))) return std::nullopt;  // nor NaN
  if (!fisheye_)
    return glm::dvec2(cx_ + fx_ * std::atan2(p.x, p.z),
                      cy_ + fy_ * std::atan2(p.y, std::hypot(p.x, p.z)));
  const double angle = std::atan2(across, p.z);
  if (!(angle <= limit_)) return std::nullopt;
  if (across == 0) return angle == 0 ? std::optional(glm::dvec2(cx_, cy_)) : std::nullopt;
  const double radius = bent(angle, k_) / across;
  return glm::dvec2(cx_ + fx_ * radius * p.x, cy_ + fy_ * radius * p.y);
}

std::optional<glm::dvec3> WideLens::unproject(const glm::dvec2& pixel) const {
  const double x = (pixel.x - cx_) / fx_, y = (pixel.y - cy_) / fy_;
  if (!fisheye_) {
    // A pixel's far corners may lie a little beyond the poles and the seam.
    if (!(std::abs(x) <= pi + 1e-9 && std::abs(y) <= pi / 2 + 1e-9)) return std::nullopt;
    return glm::dvec3(std::cos(y) * std::sin(x), std::sin(y), std::cos(y) * std::cos(x));
  }
  const double radius = std::hypot(x, y), most = bent(limit_, k_);
  if (!(radius <= most)) return std::nullopt;
  if (radius == 0) return glm::dvec3(0, 0, 1);
  double low = 0, high = limit_, angle = limit_ * radius / most;
  for (int i = 0; i < 60; ++i) {  // Newton, kept between bounds
    const double error = bent(angle, k_) - radius;
    if (std::abs(error) < 1e-14) break;
    (error > 0 ? high : low) = angle;
    const double next = angle - error / slope(angle, k_);
    angle = next > low && next < high ? next : 0.5 * (low + high);
  }
  const double across = std::sin(angle) / radius;
  return glm::dvec3(across * x, across * y, std::cos(angle));
}

}  // namespace fastibl
