#include "demo/overlay.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "fastibl/scene/response.h"

namespace fastibl::demo {
namespace {

constexpr float kUnseen = 0.35f;  // brightness of what no camera saw

// Of the n² texels of each face.
float look_up(const std::vector<float>& confidence, int n, glm::vec3 direction) {
  const FacePoint p = face_point(direction);
  const int x = std::clamp(int(p.s * float(n)), 0, n - 1);
  const int y = std::clamp(int(p.t * float(n)), 0, n - 1);
  return confidence[(std::size_t(p.face) * n + std::size_t(y)) * n + std::size_t(x)];
}

}  // namespace

void draw_map(Image<std::uint8_t>& picture, const Environment& environment, double exposure) {
  const int margin = picture.height / 48;
  const int height = std::min(picture.height / 4, picture.width / 4), width = 2 * height;
  if (height < 8 || picture.channels != 3) return;
  const int left = picture.width - width - margin, top = picture.height - height - margin;
  const ByteResponse response(Response::srgb());
  const std::vector<float> confidence = environment.confidence();
  // The level whose texels are as large as the inset's pixels.
  const float level = std::log2(float(4 * environment.radiance.size()) / float(width));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const float azimuth = 2 * kPi * ((float(x) + 0.5f) / float(width) - 0.5f);
      const float polar = kPi * (float(y) + 0.5f) / float(height);
      const glm::vec3 direction(std::sin(polar) * std::sin(azimuth),
                                std::sin(polar) * std::cos(azimuth), std::cos(polar));
      glm::vec3 colour = environment.radiance.sample(direction, level) * float(exposure);
      if (!(look_up(confidence, environment.radiance.size(), direction) > 0))
        colour *= (x + y) / 2 % 4 == 0 ? kUnseen / 4 : kUnseen;
      const bool border = x == 0 || y == 0 || x == width - 1 || y == height - 1;
      std::uint8_t* pixel = picture.pixel(left + x, top + y);
      for (int c = 0; c < 3; ++c) pixel[c] = border ? 255 : response.encode(colour[c]);
    }
}

}  // namespace fastibl::demo
