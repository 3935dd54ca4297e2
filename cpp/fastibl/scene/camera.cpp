#include "fastibl/scene/camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/scene/shared_formulas.h"
#include "fastibl/scene/wide_lens.h"

namespace fastibl {
namespace {

constexpr std::array<std::string_view, 3> kModels = {"perspective", "fisheye", "equirectangular"};
// Pixels: the longest side of a picture (3 values per pixel can still be counted in 32 bits), and
// limits of what a calibration gives: numbers beyond them are no camera's, and their products
// overflow.
constexpr int kMostSide = 16384;
constexpr double kLeastFocal = 1e-3, kMostPixels = 1e7;
constexpr double kMostCoefficient = 1e9;  // of lenses and vignetting
constexpr double kSmallestDepth = 1e-9;   // metres or unit lengths: below, a point counts as behind

// Squared radius at which r · factor(r²) stops growing, searched up to 89° off axis.
double growth_limit(const double k[8]) {
  const auto distorted = [&](double r) {
    const double q = r * r;
    return r * (1 + q * (k[0] + q * (k[1] + q * k[4]))) / (1 + q * (k[5] + q * (k[6] + q * k[7])));
  };
  const double step = 0.5 * std::numbers::pi / 2000;
  double before = 0;
  for (int i = 1; i < 1980; ++i) {
    const double r = std::tan(i * step), value = distorted(r);
    if (!(value > before)) {
      const double last = std::tan((i - 1) * step);
      return last * last;
    }
    before = value;
  }
  return std::numeric_limits<double>::infinity();
}

}  // namespace

void Camera::validate() const {
  check(width > 0 && height > 0, "a camera's picture must be at least 1 × 1, got ", width, " × ",
        height);
  check(width <= kMostSide && height <= kMostSide, "a camera's picture must be at most ", kMostSide,
        " pixels wide and high, got ", width, " × ", height);
  check(std::isfinite(fx) && std::isfinite(fy) && fx > 0 && fy > 0,
        "focal lengths must be positive and finite, got ", fx, ", ", fy);
  check(std::min(fx, fy) >= kLeastFocal && std::max(fx, fy) <= kMostPixels,
        "focal lengths must be pixels, from ", kLeastFocal, " to ", kMostPixels, ", got ", fx, ", ",
        fy);
  check(std::isfinite(cx) && std::isfinite(cy), "the principal point must be finite, got ", cx,
        ", ", cy);
  check(std::max(std::abs(cx), std::abs(cy)) <= kMostPixels,
        "the principal point must be pixels, at most ", kMostPixels, ", got ", cx, ", ", cy);
  const std::size_t n = distortion.size();
  if (model == CameraModel::perspective)
    check(n == 0 || n == 4 || n == 5 || n == 8,
          "distortion must be 0, 4, 5 or 8 numbers (k1 k2 p1 p2 [k3 [k4 k5 k6]]), got ", n);
  else if (model == CameraModel::fisheye)
    check(n == 0 || n == 4, "a fisheye's distortion must be 0 or 4 numbers (k1 k2 k3 k4), got ", n);
  else
    check(n == 0, "an equirectangular camera has no distortion, got ", n, " numbers");
  for (const double k : distortion)
    check(std::abs(k) <= kMostCoefficient, "distortion must be finite, got ", k);
  for (const double v : vignetting)
    check(std::abs(v) <= kMostCoefficient, "vignetting must be finite, got ", v);
  response.validate();
  check(gain > 0 && std::isfinite(gain), "a camera's gain must be positive and finite, got ", gain);
  check(readout >= 0 && std::isfinite(readout),
        "a camera's readout must be seconds, finite and not negative, got ", readout);
  check(field_of_view >= 1 && field_of_view <= 360,
        "a field of view must be 1 to 360 degrees, got ", field_of_view);
  check(model == CameraModel::fisheye || field_of_view == 360,
        "a field of view is told of fisheyes, got ", field_of_view, " degrees of a camera that is ",
        name(model));
}

Camera Camera::from_opencv(int width, int height, double fx, double fy, double cx, double cy,
                           std::vector<double> distortion, CameraModel model) {
  Camera camera;
  camera.width = width, camera.height = height;
  camera.fx = fx, camera.fy = fy, camera.cx = cx + 0.5, camera.cy = cy + 0.5;
  camera.distortion = std::move(distortion), camera.model = model;
  camera.validate();
  return camera;
}

Camera Camera::equirectangular(int width, int height) {
  Camera camera;
  camera.width = width, camera.height = height;
  camera.fx = 0.5 * width / std::numbers::pi, camera.fy = height / std::numbers::pi;
  camera.cx = 0.5 * width, camera.cy = 0.5 * height;
  camera.model = CameraModel::equirectangular;
  camera.validate();
  return camera;
}

std::string_view name(CameraModel model) { return kModels[std::size_t(model)]; }

CameraModel camera_model(std::string_view name) {
  const auto found = std::find(kModels.begin(), kModels.end(), name);
  check(found != kModels.end(),
        "a camera's model must be perspective, fisheye or equirectangular, got ", name);
  return CameraModel(found - kModels.begin());
}

std::optional<glm::dvec2> Camera::project(const glm::dvec3& point) const {
  return model == CameraModel::perspective ? Lens(*this).project(point)
                                           : WideLens(*this).project(point);
}
std::optional<glm::dvec3> Camera::unproject(const glm::dvec2& pixel) const {
  return model == CameraModel::perspective ? Lens(*this).unproject(pixel)
                                           : WideLens(*this).unproject(pixel);
}

double Camera::vignette(const glm::dvec2& pixel) const {
  if (vignetting.empty()) return 1;
  const double x = (pixel.x - cx) / fx, y = (pixel.y - cy) / fy, r2 = x * x + y * y;
  double factor = 1, power = r2;
  for (const double v : vignetting) factor += v * power, power *= r2;
  return std::max(factor,
                  1e-3);  // a polynomial may cross 0 in a corner; no picture is darker than this
}

Lens::Lens(const Camera& camera) : fx_(camera.fx), fy_(camera.fy), cx_(camera.cx), cy_(camera.cy) {
  check(camera.model == CameraModel::perspective,
        "boards are tracked in, and objects drawn over, perspective pictures; this camera is ",
        name(camera.model));
  trivial_ = true;
  for (std::size_t i = 0; i < camera.distortion.size() && i < 8; ++i) {
    k_[i] = camera.distortion[i];
    trivial_ = trivial_ && k_[i] == 0;
  }
  limit2_ = trivial_ ? std::numeric_limits<double>::infinity() : growth_limit(k_);
}

glm::dvec2 Lens::distort(const glm::dvec2& p, glm::dmat2* derivative) const {
  if (derivative) {
    const double x = p.x, y = p.y, q = x * x + y * y;
    const double num = 1 + q * (k_[0] + q * (k_[1] + q * k_[4]));
    const double den = 1 + q * (k_[5] + q * (k_[6] + q * k_[7]));
    const double g = num / den, p1 = k_[2], p2 = k_[3];
    const double dnum = k_[0] + q * (2 * k_[1] + q * 3 * k_[4]);
    const double dden = k_[5] + q * (2 * k_[6] + q * 3 * k_[7]);
    const double h = 2 * (dnum - g * dden) / den;  // dg/dx = h x
    const double cross = h * x * y + 2 * p1 * x + 2 * p2 * y;
    *derivative = glm::dmat2(g + h * x * x + 2 * p1 * y + 6 * p2 * x, cross,   // ∂/∂x
                             cross, g + h * y * y + 6 * p1 * y + 2 * p2 * x);  // ∂/∂y
  }
  return shared::distort(p, k_);
}

std::optional<glm::dvec2> Lens::project(const glm::dvec3& point, glm::dmat2x3* derivative) const {
  if (!(point.z > kSmallestDepth)) return std::nullopt;
  const double iz = 1 / point.z;
  const glm::dvec2 ideal(point.x * iz, point.y * iz);
  if (!valid(ideal)) return std::nullopt;
  glm::dmat2 d(1.0);
  const glm::dvec2 distorted = trivial_ ? ideal : distort(ideal, derivative ? &d : nullptr);
  if (derivative) {
    // Rows u and v of the derivative with respect to the point, stored as the columns of a 3×2.
    const glm::dvec3 dx(iz, 0, -ideal.x * iz), dy(0, iz, -ideal.y * iz);
    (*derivative)[0] = fx_ * (d[0][0] * dx + d[1][0] * dy);
    (*derivative)[1] = fy_ * (d[0][1] * dx + d[1][1] * dy);
  }
  const glm::dvec2 pixel(fx_ * distorted.x + cx_, fy_ * distorted.y + cy_);
  if (!(std::isfinite(pixel.x) && std::isfinite(pixel.y))) return std::nullopt;
  return pixel;
}

std::optional<glm::dvec3> Lens::unproject(const glm::dvec2& pixel) const {
  const glm::dvec2 target((pixel.x - cx_) / fx_, (pixel.y - cy_) / fy_);
  if (!(std::isfinite(target.x) && std::isfinite(target.y))) return std::nullopt;
  if (trivial_) return glm::dvec3(target, 1);
  glm::dvec2 p = valid(target) ? target : target * (0.9 * std::sqrt(limit2_) / glm::length(target));
  for (int i = 0; i < 30; ++i) {  // Newton; steps are halved when they leave the valid disc
    glm::dmat2 d;
    const glm::dvec2 error = distort(p, &d) - target;
    if (glm::dot(error, error) < 1e-24) return glm::dvec3(p, 1);
    glm::dvec2 step = glm::inverse(d) * error;
    if (!(std::isfinite(step.x) && std::isfinite(step.y))) return std::nullopt;
    for (int half = 0; half < 20 && !valid(p - step); ++half) step *= 0.5;
    p -= step;
    if (!valid(p)) return std::nullopt;
  }
  const glm::dvec2 error = distort(p) - target;
  if (glm::dot(error, error) > 1e-16) return std::nullopt;
  return glm::dvec3(p, 1);
}

void Rig::validate() const {
  back.validate();
  if (front) front->validate(), front_from_back.validate();
}

}  // namespace fastibl
