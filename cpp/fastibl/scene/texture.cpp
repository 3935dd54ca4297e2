#include "fastibl/scene/texture.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

Image<float> half(const Image<float>& fine) {
  Image<float> coarse(std::max(1, fine.width / 2), std::max(1, fine.height / 2), fine.channels);
  for (int y = 0; y < coarse.height; ++y)
    for (int x = 0; x < coarse.width; ++x) {
      const int x1 = std::min(2 * x + 1, fine.width - 1), y1 = std::min(2 * y + 1, fine.height - 1);
      for (int c = 0; c < fine.channels; ++c)
        coarse.pixel(x, y)[c] = 0.25f * (fine.pixel(2 * x, 2 * y)[c] + fine.pixel(x1, 2 * y)[c] +
                                         fine.pixel(2 * x, y1)[c] + fine.pixel(x1, y1)[c]);
    }
  return coarse;
}

int wrapped(int i, int n) {
  const int rest = i % n;
  return rest < 0 ? rest + n : rest;
}

glm::vec3 texel(const Image<float>& image, int x, int y) {
  const float* p = image.pixel(wrapped(x, image.width), wrapped(y, image.height));
  return image.channels == 3 ? glm::vec3(p[0], p[1], p[2]) : glm::vec3(p[0]);
}

glm::vec3 bilinear(const Image<float>& image, glm::vec2 uv) {
  const float x = uv.x * float(image.width) - 0.5f, y = uv.y * float(image.height) - 0.5f;
  const float left = std::floor(x), top = std::floor(y);
  const int ix = int(left), iy = int(top);
  const glm::vec3 upper = glm::mix(texel(image, ix, iy), texel(image, ix + 1, iy), x - left);
  const glm::vec3 lower =
      glm::mix(texel(image, ix, iy + 1), texel(image, ix + 1, iy + 1), x - left);
  return glm::mix(upper, lower, y - top);
}

}  // namespace

SurfaceTexture::SurfaceTexture(Image<float> image) {
  check(!image.empty(), "a texture needs at least one texel");
  check(image.channels == 1 || image.channels == 3, "a texture has 1 or 3 channels, got ",
        image.channels);
  for (const float value : image.data)
    check(std::isfinite(value), "a texture's values must be finite, got ", value);
  largest_ = texel(image, 0, 0);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) largest_ = glm::max(largest_, texel(image, x, y));
  levels_.push_back(std::move(image));
  while (levels_.back().width > 1 || levels_.back().height > 1)
    levels_.push_back(half(levels_.back()));
}

glm::vec3 SurfaceTexture::sample(glm::vec2 uv, float level) const {
  if (!(std::isfinite(uv.x) && std::isfinite(uv.y))) uv = glm::vec2(0);
  uv = glm::vec2(uv.x - std::floor(uv.x), 1 - (uv.y - std::floor(uv.y)));
  const float clamped = level > 0 ? std::min(level, float(level_count() - 1)) : 0.0f;
  const int k = int(clamped);
  const glm::vec3 fine = bilinear(levels_[std::size_t(k)], uv);
  if (clamped == float(k)) return fine;
  return glm::mix(fine, bilinear(levels_[std::size_t(k) + 1], uv), clamped - float(k));
}

float SurfaceTexture::level_of(glm::vec2 uv_dx, glm::vec2 uv_dy) const {
  return shared::texture_level(glm::vec2(width(), height()), uv_dx, uv_dy);
}

}  // namespace fastibl
