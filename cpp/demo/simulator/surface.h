// A rectangle of the room with pictures of its albedo, emission and, once lit, radiance.
#pragma once

#include <functional>

#include "fastibl/core/image.h"
#include "fastibl/core/simd.h"
#include "fastibl/core/vector.h"

namespace fastibl::demo {

// It is matte: what it sends out looks the same from everywhere.
struct Surface {
  glm::vec3 origin{0}, u{0}, v{0};          // a corner, and unit vectors along its edges
  glm::vec3 normal{0};                      // into the room
  glm::vec2 size{0};                        // metres along u and v
  float density = 100;                      // texels per metre
  Image<float> albedo, emission, radiance;  // RGB and an unused fourth channel: a texel is one load
  Image<float> irradiance;                  // coarse, over the whole rectangle

  glm::vec3 point(float a, float b) const { return origin + a * u + b * v; }  // a, b: metres
};

// What a surface is made of at a place, given in metres along u and v.
struct Paint {
  glm::vec3 albedo{0.5f}, emission{0};
};
void paint(Surface& surface, const std::function<Paint(float, float)>& at);

// Interpolates bilinearly between texel centres and clamps at the border. s and t: in texels.
inline glm::vec3 look_up(const Image<float>& image, float s, float t) {
  s = glm::clamp(s - 0.5f, 0.0f, float(image.width - 1));
  t = glm::clamp(t - 0.5f, 0.0f, float(image.height - 1));
  const int x = int(s), y = int(t);
  const int right = x + 1 < image.width ? 4 : 0;
  const float* above = image.pixel(x, y);
  const float* below = y + 1 < image.height ? image.pixel(x, y + 1) : above;
  const float fx = s - float(x), fy = t - float(y);
  const auto texel = [](const float* p) -> const Float4& {
    return *reinterpret_cast<const Float4*>(p);
  };
  const Float4 top = texel(above) + fx * (texel(above + right) - texel(above));
  const Float4 bottom = texel(below) + fx * (texel(below + right) - texel(below));
  const Float4 value = top + fy * (bottom - top);
  return {value[0], value[1], value[2]};
}
inline glm::vec3 radiance_at(const Surface& surface, float a, float b) {
  return look_up(surface.radiance, a * surface.density, b * surface.density);
}
inline glm::vec3 irradiance_at(const Surface& surface, float a, float b) {
  const Image<float>& coarse = surface.irradiance;
  return look_up(coarse, a / surface.size.x * float(coarse.width),
                 b / surface.size.y * float(coarse.height));
}

}  // namespace fastibl::demo
