#include "fastibl/capture/bright_spots.h"

#include <algorithm>
#include <cstdint>

namespace fastibl {
namespace {

constexpr int kColumns = 80;  // blocks a row, about: window bars of a degree part nothing
constexpr int kSamples = 2;   // pixels read along each edge of a block
constexpr int kLeastBlocks = 3;
// Shares of white: thresholds between these can be told from noise and from a block that is half
// white.
constexpr double kLeastLinear = 0.003, kMostLinear = 0.4;

struct Spot {
  glm::dvec3 sum{0};  // of directions in the camera frame, weighted by solid angle
  double solid_angle = 0;
  int blocks = 0;
  double rows = 0;   // sum over its blocks
  bool cut = false;  // by the picture's border, or by what is hidden
};

}  // namespace

std::optional<std::vector<BrightSpot>> find_bright_spots(const PixelReader& pixels,
                                                         const Camera& camera, const Lens& lens,
                                                         const RowPoses& camera_from_marker,
                                                         double exposure, double radiance,
                                                         const PictureMask& hidden) {
  const double threshold = radiance * exposure * camera.gain;
  if (!(threshold >= kLeastLinear && threshold <= kMostLinear)) return std::nullopt;
  const int step = std::max(1, (camera.width + kColumns / 2) / kColumns);
  const int width = camera.width / step, height = camera.height / step;
  if (width < 3 || height < 3) return std::nullopt;
  const auto middle = [&](int i) { return (i + 0.5) * step; };
  const auto brightness = [&](int x, int y) {
    const glm::dvec3 linear(pixels.linear(x, y));
    return (linear.x + linear.y + linear.z) / 3;
  };
  const auto block = [&](int x, int y) {
    double sum = 0;
    for (int v = 0; v < kSamples; ++v)
      for (int u = 0; u < kSamples; ++u)
        sum += brightness(x * step + (2 * u + 1) * step / (2 * kSamples),
                          y * step + (2 * v + 1) * step / (2 * kSamples));
    return sum / (kSamples * kSamples);
  };

  // beside: with so many blocks around it.
  const auto is_hidden = [&](int x, int y, int beside) {
    return hidden.hides_any((x - beside) * step, (y - beside) * step, (x + beside + 1) * step,
                            (y + beside + 1) * step);
  };

  // Rows of runs would do, too, but so few pixels are bright that a flood fill costs nothing.
  std::vector<std::uint8_t> bright(std::size_t(width * height));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      double limit = threshold;
      if (!camera.vignetting.empty()) limit *= camera.vignette({middle(x), middle(y)});
      bright[std::size_t(y * width + x)] = block(x, y) > limit && !is_hidden(x, y, 0);
    }

  const double block_area = double(step * step) / (camera.fx * camera.fy);
  std::vector<BrightSpot> spots;
  std::vector<int> open;
  for (int start = 0; start < width * height; ++start) {
    if (!bright[std::size_t(start)]) continue;
    Spot spot;
    open.assign(1, start);
    bright[std::size_t(start)] = 0;
    while (!open.empty()) {
      const int x = open.back() % width, y = open.back() / width;
      open.pop_back();
      spot.cut |= x == 0 || y == 0 || x == width - 1 || y == height - 1 || is_hidden(x, y, 1);
      if (const auto ray = lens.unproject({middle(x), middle(y)})) {
        const double length = glm::length(*ray), angle = block_area / (length * length * length);
        spot.sum += *ray * (angle / length);
        spot.solid_angle += angle;
        spot.rows += middle(y);
        ++spot.blocks;
      } else {
        spot.cut = true;
      }
      for (int v = std::max(0, y - 1); v <= std::min(height - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(width - 1, x + 1); ++u)
          if (std::uint8_t& next = bright[std::size_t(v * width + u)]) {
            next = 0;
            open.push_back(v * width + u);
          }
    }
    if (spot.cut || spot.blocks < kLeastBlocks) continue;
    const Pose pose = camera_from_marker.at(spot.rows / spot.blocks / camera.height);
    spots.push_back({glm::transpose(pose.rotation) * glm::normalize(spot.sum), spot.solid_angle});
  }
  return spots;
}

}  // namespace fastibl
