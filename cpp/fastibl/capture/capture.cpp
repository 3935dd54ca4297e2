#include "fastibl/capture/capture.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "fastibl/capture/frame_pyramid.h"
#include "fastibl/capture/texel_view.h"
#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr int kTile = 16;  // texels: culled against the picture as one
// Relative standard deviation of a sample from misregistration and the lens, whatever the sensor.
constexpr float kModelNoise = 0.03f;
// Relative standard deviation by which a value becomes unsure within a second.
constexpr float kDrift = 0.1f;
// A sample further than this many standard deviations from the value is a change of the place.
constexpr float kChange = 4.0f;
constexpr float kClippedShare = 0.01f;  // of a footprint: more makes the sample a lower bound
constexpr float kBoundNoise = 1.0f;  // relative standard deviation of a value that is only a bound
// A full well of 4000 electrons and 6 of read noise: variance per linear value, and at 0.
constexpr float kShotNoise = 1 / 4000.0f;
constexpr float kReadNoise = 6 / 4000.0f * 6 / 4000.0f;
constexpr double kNever = -std::numeric_limits<double>::infinity();
constexpr double kBoardMargin = 0.01;  // metres around the page, for blur and the pose's error

}  // namespace

// Variance of a mean over pixels by its linear value: read and shot noise, and a code of
// quantisation. The first two are cut off at 0, and codes repeat (a dark wall is all of one): such
// departures do not average away, so a quarter of the variance stays however large the footprint.
class Capture::SensorNoise {
 public:
  explicit SensorNoise(const Response& response) {
    for (int k = 0; k <= kBins; ++k) {
      const float y = float(k) / kBins * float(k) / kBins;  // finer in the dark
      const float e = response.encode(y);
      const float step = response.decode(std::min(1.0f, e + 0.5f / 255)) -
                         response.decode(std::max(0.0f, e - 0.5f / 255));
      variance_[std::size_t(k)] = step * step + kReadNoise;
    }
  }
  float variance(float y, float pixels) const {
    const float x = std::sqrt(std::clamp(y, 0.0f, 1.0f)) * kBins;
    const float code = variance_[std::size_t(x)];
    return 0.25f * code + (0.75f * code + kShotNoise * y) / std::max(pixels, 1.0f);
  }

 private:
  static constexpr int kBins = 256;
  std::array<float, kBins + 1> variance_{};
};

Capture::Capture(CaptureOptions options) : options_(std::move(options)) {
  const int n = options_.size;
  check(n >= 1 && n <= 4096, "the map's size must be 1 to 4096 texels, got ", n);
  const glm::dvec3& centre = options_.centre;
  check(std::isfinite(centre.x) && std::isfinite(centre.y) && std::isfinite(centre.z),
        "the centre must be finite, got ", centre.x, " ", centre.y, " ", centre.z);
  check(centre.z > 0, "the centre must lie above the plane (z > 0), got z = ", centre.z);
  check(options_.distance > 0, "the distance of the place must be positive (metres), got ",
        options_.distance);
  check(options_.plane_albedo > 0 && options_.plane_albedo <= 1,
        "the plane's albedo must be in (0, 1], got ", options_.plane_albedo);
  const std::size_t count = 6 * std::size_t(n) * std::size_t(n);
  directions_.reserve(count);
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x)
        directions_.push_back(glm::normalize(texel_direction(f, x, y, n)));
  for (const double angle : texel_solid_angles(n)) solid_angle_.push_back(float(angle));
  value_.assign(count, glm::vec3(0));
  variance_.assign(count, glm::vec3(0));
  bound_.assign(count, 0);
  last_seen_.assign(count, kNever);
  nearest_.assign(count, -1);
}

void Capture::add(const Picture& picture, const Camera& camera, const Pose& camera_from_marker,
                  double exposure, double time, ImageView<const std::uint8_t> mask) {
  camera.validate();
  check(picture.width == camera.width && picture.height == camera.height,
        "the picture must be the camera's ", camera.width, " × ", camera.height, ", got ",
        picture.width, " × ", picture.height);
  check(mask.empty() || (mask.width == camera.width && mask.height == camera.height),
        "the mask must be the camera's ", camera.width, " × ", camera.height, ", got ", mask.width,
        " × ", mask.height);
  check(exposure > 0 && std::isfinite(exposure), "an exposure must be positive and finite, got ",
        exposure);
  check(std::isfinite(time) && time >= time_, "time must not run backwards: ", time, " s after ",
        time_, " s");
  time_ = time;

  Viewpoint viewpoint{options_.centre, options_.distance};
  if (options_.board)
    viewpoint.masked =
        0.5 * glm::dvec2(options_.board->width, options_.board->height) + kBoardMargin;
  const TexelView view(camera, camera_from_marker, viewpoint);
  const FramePyramid pyramid(picture, camera.response);
  const SensorNoise noise(camera.response);

  const int n = options_.size, tiles = (n + kTile - 1) / kTile;
  std::vector<std::uint8_t> newly_seen(std::size_t(6 * tiles * tiles), 0);
  parallel_for(6 * tiles * tiles, 4, [&](int begin, int end) {
    for (int tile = begin; tile < end; ++tile) {
      const int face = tile / (tiles * tiles), x0 = tile % tiles * kTile,
                y0 = tile / tiles % tiles * kTile;
      const int x1 = std::min(x0 + kTile, n), y1 = std::min(y0 + kTile, n);
      if (!view.may_see(face, x0, y0, x1, y1, n)) continue;
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) {
          const std::size_t in_face = std::size_t(y) * n + std::size_t(x),
                            i = std::size_t(face) * n * n + in_face;
          const auto seen = view.see(glm::dvec3(directions_[i]), solid_angle_[in_face]);
          if (!seen) continue;
          const glm::dvec2 pixel = seen->pixel;
          if (!mask.empty() && *mask.pixel(int(pixel.x), int(pixel.y)) == 0) continue;
          if (last_seen_[i] == kNever) newly_seen[std::size_t(tile)] = 1;
          const double radiance_per_linear = 1 / (exposure * camera.gain * camera.vignette(pixel));
          merge(i, pyramid.sample(float(pixel.x), float(pixel.y), std::sqrt(seen->area)),
                seen->area, float(radiance_per_linear), noise);
        }
    }
  });
  for (const std::uint8_t changed : newly_seen) coverage_changed_ = coverage_changed_ || changed;
}

// Takes a sample of texel i, linear values over `pixels` pixels, into its estimate.
void Capture::merge(std::size_t i, const FootprintSample& seen, float pixels,
                    float radiance_per_linear, const SensorNoise& noise) {
  const bool first = last_seen_[i] == kNever;
  const float elapsed = first ? 0.0f : float(time_ - last_seen_[i]);
  last_seen_[i] = time_;
  for (int c = 0; c < 3; ++c) {
    float &value = value_[i][c], &variance = variance_[i][c];
    const float sample = seen.linear[c] * radiance_per_linear;
    const std::uint8_t bit = std::uint8_t(1 << c);
    if (seen.clipped[c] > kClippedShare) {
      if (first || value < sample) {
        value = sample, variance = kBoundNoise * kBoundNoise * sample * sample;
        bound_[i] |= bit;
      }
      continue;
    }
    const float model_noise = kModelNoise * sample;
    const float sample_variance =
        noise.variance(seen.linear[c], pixels) * radiance_per_linear * radiance_per_linear +
        model_noise * model_noise;
    if (!first) variance += kDrift * kDrift * value * value * elapsed;
    const float difference = sample - value;
    // A bound is no measurement, and what contradicts the value is a change of the place.
    if (first || (bound_[i] & bit) ||
        difference * difference > kChange * kChange * (variance + sample_variance)) {
      value = sample, variance = sample_variance;
      bound_[i] &= std::uint8_t(~bit);
      continue;
    }
    const float gain = variance / std::max(variance + sample_variance, 1e-30f);
    value += gain * difference;
    variance *= 1 - gain;
  }
}

// Nearest seen texel for every unseen one on its side of the horizon: sources spread from neighbour
// to neighbour as long as that brings a texel closer to its source.
void Capture::update_nearest() {
  const int n = options_.size;
  const std::size_t count = directions_.size();
  if (neighbours_.empty()) {
    neighbours_.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const int f = int(i / (std::size_t(n) * n)), y = int(i / n % n), x = int(i % n);
      const int steps[4][2] = {{x - 1, y}, {x + 1, y}, {x, y - 1}, {x, y + 1}};
      for (std::size_t k = 0; k < 4; ++k) {
        const FacePoint p = face_point(texel_direction(f, steps[k][0], steps[k][1], n));
        const int px = std::clamp(int(p.s * float(n)), 0, n - 1),
                  py = std::clamp(int(p.t * float(n)), 0, n - 1);
        neighbours_[i][k] = (p.face * n + py) * n + px;
      }
    }
  }
  std::deque<int> queue;
  for (std::size_t i = 0; i < count; ++i) {
    nearest_[i] = last_seen_[i] != kNever ? int(i) : -1;
    if (nearest_[i] >= 0) queue.push_back(int(i));
  }
  while (!queue.empty()) {
    const std::size_t i = std::size_t(queue.front());
    queue.pop_front();
    const int source = nearest_[i];
    for (const int k : neighbours_[i]) {
      const std::size_t j = std::size_t(k);
      if (nearest_[j] == k || (directions_[j].z < 0) != (directions_[i].z < 0)) continue;
      if (nearest_[j] >= 0 && glm::dot(directions_[j], directions_[std::size_t(nearest_[j])]) >=
                                  glm::dot(directions_[j], directions_[std::size_t(source)]))
        continue;
      nearest_[j] = source;
      queue.push_back(k);
    }
  }
  coverage_changed_ = false;
}

std::shared_ptr<const Environment> Capture::environment() {
  if (coverage_changed_) update_nearest();
  const std::size_t count = directions_.size(), per_face = solid_angle_.size();
  auto result = std::make_shared<Environment>();
  result->confidence.resize(count);
  result->age.resize(count);
  std::vector<glm::vec3> faces(count);
  glm::dvec3 up_irradiance(0), plane_mean(0);
  double up = 0, seen = 0, up_seen = 0, bound_flux = 0, flux = 0, bound = 0, plane_seen = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double angle = solid_angle_[i % per_face];
    const bool is_seen = nearest_[i] == int(i), above = directions_[i].z >= 0;
    if (nearest_[i] >= 0) faces[i] = value_[std::size_t(nearest_[i])];
    const double brightness = faces[i].x + faces[i].y + faces[i].z;
    if (above) {
      up += angle, flux += angle * brightness;
      up_irradiance += angle * double(directions_[i].z) * glm::dvec3(faces[i]);
    }
    result->age[i] =
        is_seen ? float(time_ - last_seen_[i]) : std::numeric_limits<float>::infinity();
    if (!is_seen) continue;
    seen += angle;
    if (above)
      up_seen += angle;
    else
      plane_seen += angle, plane_mean += angle * glm::dvec3(faces[i]);
    if (bound_[i]) bound += angle, bound_flux += above ? angle * brightness : 0;
    const glm::vec3 variance =
        variance_[i] + kDrift * kDrift * faces[i] * faces[i] * result->age[i];
    const float relative =
        (variance.x + variance.y + variance.z) / std::max(1e-20f, glm::dot(faces[i], faces[i]));
    result->confidence[i] = 1 / (1 + relative / (0.1f * 0.1f));  // ½ at 10 % standard deviation
  }
  // Nothing of the upper half seen: a uniform sky that would light the plane as it looks, or
  // mid-grey.
  if (up_seen == 0) {
    const glm::vec3 sky = plane_seen > 0
                              ? glm::vec3(plane_mean / plane_seen / options_.plane_albedo)
                              : glm::vec3(0.5f);
    for (std::size_t i = 0; i < count; ++i)
      if (directions_[i].z >= 0) faces[i] = sky;
    up_irradiance = glm::dvec3(sky) * std::numbers::pi;
  }
  if (plane_seen == 0) {
    const glm::vec3 plane(options_.plane_albedo / std::numbers::pi * up_irradiance);
    for (std::size_t i = 0; i < count; ++i)
      if (directions_[i].z < 0) faces[i] = plane;
  }
  constexpr double sphere = 4 * std::numbers::pi;
  result->coverage = seen / sphere;
  result->clipped = seen > 0 ? bound / seen : 0;
  // Expected error of the irradiance, fitted to nearest-seen filling on real maps: it falls
  // faster than what is unseen above the horizon. Light known only as a lower bound may be twice
  // as strong.
  const double unseen = 1 - up_seen / up;
  result->predicted_error =
      0.02 + 0.85 * std::pow(unseen, 1.5) + (flux > 0 ? 0.5 * bound_flux / flux : 0);
  result->radiance = CubeMap(options_.size, faces);
  return result;
}

}  // namespace fastibl
