#include "demo/simulator/eye.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "fastibl/core/check.h"

namespace fastibl::demo {
namespace {

// Of a telephone's sensor, in electrons.
constexpr float kFullWell = 4000, kReadNoise = 6;
constexpr float kReadVariance = kReadNoise * kReadNoise / (kFullWell * kFullWell);
constexpr std::size_t kNoise = 1 << 16;  // places from which a row may take its noise

// Directions through any point of the picture, between those of every fourth pixel: within 0.001
// pixels, and hundreds of times faster than the lens model's inverse.
class Rays {
 public:
  explicit Rays(const Camera& camera) : width_(camera.width / kStep + 2) {
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

}  // namespace

Eye::Eye(const Camera& camera) : camera_(camera), response_(camera.response) {
  const Rays rays(camera);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      rays_.push_back(rays.at(x + 0.5, y + 0.5));
      for (int k = 0; k < 4; ++k)
        fine_.push_back(rays.at(x + 0.25 + 0.5 * (k % 2), y + 0.25 + 0.5 * (k / 2)));
      factor_.push_back(float(camera.gain * camera.vignette({x + 0.5, y + 0.5})));
    }
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  for (std::size_t k = 0; k < kNoise + 3 * std::size_t(camera.width); ++k)
    noise_.push_back(normal(random));
}

// A pixel of which the page may be a part.
glm::vec3 Eye::on_table(const Room& room, const Page& page, const glm::vec3& eye,
                        const glm::mat3& marker_from_camera, int x, int y,
                        const glm::vec3& radiance) const {
  const std::size_t pixel = std::size_t(y) * std::size_t(camera_.width) + std::size_t(x);
  glm::vec3 sum(0);
  glm::vec2 middle(0);
  float albedo = 0, share = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const glm::vec3 d = marker_from_camera * fine_[4 * pixel + k];
    const glm::vec2 at = glm::vec2(eye) - glm::vec2(d) * (eye.z / d.z);
    if (!(d.z < 0)) continue;
    if (const std::optional<float> paper = page.albedo(at))
      albedo += 0.25f * *paper, share += 0.25f, middle = at;
  }
  if (share == 0) return radiance;
  sum = room.table_irradiance(middle) * (albedo / kPi);
  return sum + (1 - share) * radiance;
}

Image<std::uint8_t> Eye::take(const Room& room, const Page& page, const Pose& camera_from_marker,
                              double exposure, std::uint32_t seed) const {
  const Pose marker_from_camera = camera_from_marker.inverse();
  const glm::mat3 turn(marker_from_camera.rotation);
  const glm::vec3 eye(marker_from_camera.translation);
  const glm::vec2 reach = page.half_size() + 0.01f;  // metres
  Image<std::uint8_t> picture(camera_.width, camera_.height, 3);
  std::vector<float> row(std::size_t(camera_.width) * 3);
  std::minstd_rand random(seed);
  for (int y = 0; y < camera_.height; ++y) {
    const std::size_t first = std::size_t(y) * std::size_t(camera_.width);
    for (int x = 0; x < camera_.width; ++x) {
      const glm::vec3 d = turn * rays_[first + std::size_t(x)];
      glm::vec3 light = room.radiance(eye, d);
      if (d.z < 0) {
        const glm::vec2 at = glm::vec2(eye) - glm::vec2(d) * (eye.z / d.z);
        if (std::abs(at.x) < reach.x && std::abs(at.y) < reach.y)
          light = on_table(room, page, eye, turn, x, y, light);
      }
      light *= factor_[first + std::size_t(x)] * float(exposure);
      for (int c = 0; c < 3; ++c) row[std::size_t(3 * x + c)] = std::min(light[c], 2.0f);
    }
    const float* noise = &noise_[random() % kNoise];
    for (std::size_t k = 0; k < row.size(); ++k)  // shot and read noise
      row[k] += noise[k] * std::sqrt(row[k] / kFullWell + kReadVariance);
    for (float& value : row) value = std::clamp(value, 0.0f, 1.0f);
    response_.encode(row.data(), picture.row(y), row.size());
  }
  return picture;
}

}  // namespace fastibl::demo
