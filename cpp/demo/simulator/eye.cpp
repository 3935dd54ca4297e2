#include "demo/simulator/eye.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "fastibl/core/check.h"
#include "fastibl/core/simd.h"

namespace fastibl::demo {
namespace {

// Values of a telephone's sensor, in electrons.
constexpr float kFullWell = 4000, kReadNoise = 6;
constexpr float kReadVariance = kReadNoise * kReadNoise / (kFullWell * kFullWell);
constexpr std::size_t kNoise = 1 << 16;  // places at which a row's noise may begin

// Directions through any point of the picture, interpolated between those of every fourth pixel.
// That is right within 0.001 pixels, and hundreds of times faster than the lens model's inverse.
class LensRays {
 public:
  explicit LensRays(const Camera& camera) : width_(camera.width / kStep + 2) {
    const Lens lens(camera);
    for (int y = 0; y <= camera.height / kStep + 1; ++y)
      for (int x = 0; x < width_; ++x) {
        const auto ray = lens.unproject({double(x * kStep), double(y * kStep)});
        check(ray.has_value(), "the lens model does not reach the picture's corners");
        known_.push_back(*ray);
      }
  }
  glm::vec3 at(double x, double y) const {
    x /= kStep, y /= kStep;
    const std::size_t at = std::size_t(y) * std::size_t(width_) + std::size_t(x);
    const double fx = x - std::floor(x), fy = y - std::floor(y);
    const glm::dvec3* above = &known_[at];
    const glm::dvec3* below = above + width_;
    return glm::vec3(
        glm::mix(glm::mix(above[0], above[1], fx), glm::mix(below[0], below[1], fx), fy));
  }

 private:
  static constexpr int kStep = 4;  // pixels
  int width_;
  std::vector<glm::dvec3> known_;
};

// m (x, y, z) for many vectors.
FASTIBL_CLONES void turn_all(const glm::mat3& m, const float* x, const float* y, const float* z,
                             std::size_t count, float* __restrict to_x, float* __restrict to_y,
                             float* __restrict to_z) {
  const glm::vec3 a = m[0], b = m[1], c = m[2];
  for (std::size_t k = 0; k < count; ++k) {
    to_x[k] = a.x * x[k] + b.x * y[k] + c.x * z[k];
    to_y[k] = a.y * x[k] + b.y * y[k] + c.y * z[k];
    to_z[k] = a.z * x[k] + b.z * y[k] + c.z * z[k];
  }
}

// Turns light on a sensor (1: full) into what is read from it, with shot noise and read noise made
// from standard normals.
FASTIBL_CLONES void read_out(float* __restrict values, const float* __restrict noise,
                             std::size_t count) {
  for (std::size_t k = 0; k < count; ++k) {
    const float v = values[k] < 2 ? values[k] : 2;
    const float read = v + noise[k] * std::sqrt(v * (1 / kFullWell) + kReadVariance);
    const float above = read > 0 ? read : 0;
    values[k] = above < 1 ? above : 1;
  }
}

}  // namespace

Eye::Eye(const Camera& camera) : camera_(camera), response_(camera.response) {
  const LensRays rays(camera);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const glm::vec3 middle = rays.at(x + 0.5, y + 0.5);
      rays_.x.push_back(middle.x), rays_.y.push_back(middle.y), rays_.z.push_back(middle.z);
      FourRays& fine = fine_.emplace_back();
      for (int k = 0; k < 4; ++k) {
        const glm::vec3 ray = rays.at(x + 0.25 + 0.5 * (k % 2), y + 0.25 + 0.5 * (k / 2));
        fine.x[k] = ray.x, fine.y[k] = ray.y, fine.z[k] = ray.z;
      }
      factor_.push_back(float(camera.gain * camera.vignette({x + 0.5, y + 0.5})));
    }
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  for (std::size_t k = 0; k < kNoise + 3 * std::size_t(camera.width); ++k)
    noise_.push_back(normal(random));
}

// How much of a pixel is paper, judged by 2 × 2 points, and with which albedo.
Page::Paper Eye::paper_at(const Page& page, const glm::vec3& eye, const glm::mat3& turn,
                          std::size_t pixel) const {
  const FourRays& rays = fine_[pixel];
  const auto turned = [&](int c) {
    return turn[0][c] * rays.x + turn[1][c] * rays.y + turn[2][c] * rays.z;
  };
  const Float4 distance = -eye.z / turned(2);  // below 0 if a ray goes up: far off the page
  return page.at(eye.x + turned(0) * distance, eye.y + turned(1) * distance);
}

Image<std::uint8_t> Eye::take(const Room& room, const Page& page, const Pose& camera_from_marker,
                              double exposure, std::uint32_t seed) const {
  const Pose marker_from_camera = camera_from_marker.inverse();
  const glm::mat3 turn(marker_from_camera.rotation);
  const glm::vec3 eye(marker_from_camera.translation);
  const glm::vec2 reach = page.half_size() + 0.01f;  // metres
  Image<std::uint8_t> picture(camera_.width, camera_.height, 3);
  std::minstd_rand random(seed);
  const std::size_t width = std::size_t(camera_.width);
  Rays rays(width);
  std::vector<glm::vec3> light(width);
  for (int y = 0; y < camera_.height; ++y) {
    const std::size_t first = std::size_t(y) * width;
    turn_all(turn, &rays_.x[first], &rays_.y[first], &rays_.z[first], width, rays.x.data(),
             rays.y.data(), rays.z.data());
    room.radiance(eye, rays, light.data());
    for (std::size_t k = 0; k < width; ++k) {
      const float distance = -eye.z / rays.z[k];  // to the table
      const glm::vec2 place(eye.x + rays.x[k] * distance, eye.y + rays.y[k] * distance);
      if (!(rays.z[k] < 0 && std::abs(place.x) < reach.x && std::abs(place.y) < reach.y)) continue;
      const Page::Paper paper = paper_at(page, eye, turn, first + k);
      if (paper.share > 0)
        light[k] = (1 - paper.share) * light[k] +
                   room.table_irradiance(place) * (paper.share * paper.albedo / kPi);
    }
    for (std::size_t k = 0; k < width; ++k) light[k] *= factor_[first + k] * float(exposure);
    read_out(&light[0].x, &noise_[random() % kNoise], 3 * width);
    response_.encode(&light[0].x, picture.row(y), 3 * width);
  }
  return picture;
}

}  // namespace fastibl::demo
