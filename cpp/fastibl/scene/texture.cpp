#include "fastibl/scene/texture.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

// Weights of texels 2 i, 2 i + 1 and 2 i + 2 of `size` in texel i of the level with half as many.
// Where `size` is odd, each coarse texel covers a little more than two: Guthe and Heckbert 2005,
// Non-power-of-two mipmapping.
struct Weights {
  float of[3];
};
Weights halving(int i, int size) {
  if (size == 1) return {{1, 0, 0}};
  if (size % 2 == 0) return {{0.5f, 0.5f, 0}};
  const float n = float(size), m = float(size / 2);
  return {{(m - float(i)) / n, m / n, (float(i) + 1) / n}};
}

Image<float> half(const Image<float>& fine) {
  Image<float> coarse(std::max(1, fine.width / 2), std::max(1, fine.height / 2), fine.channels);
  for (int y = 0; y < coarse.height; ++y) {
    const Weights down = halving(y, fine.height);
    for (int x = 0; x < coarse.width; ++x) {
      const Weights across = halving(x, fine.width);
      for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 3; ++i) {
          const float weight = down.of[j] * across.of[i];
          if (weight == 0) continue;
          const float* p = fine.pixel(2 * x + i, 2 * y + j);
          for (int c = 0; c < fine.channels; ++c) coarse.pixel(x, y)[c] += weight * p[c];
        }
    }
  }
  return coarse;
}

constexpr std::array<std::string_view, 3> kWraps = {"repeat", "clamp", "mirror"};

// The u in [0, 1] that shows the same.
float folded(float u, Wrap wrap) {
  switch (wrap) {
    case Wrap::repeat:
      return u - std::floor(u);
    case Wrap::clamp:
      return std::clamp(u, 0.0f, 1.0f);
    case Wrap::mirror:
      break;
  }
  const float half = 0.5f * u;
  return 1 - std::abs(2 * (half - std::floor(half)) - 1);
}

// For texels -1 to n.
int wrapped(int i, int n, Wrap wrap) {
  if (wrap == Wrap::repeat) return i < 0 ? i + n : i >= n ? i - n : i;
  return std::clamp(i, 0, n - 1);  // a mirror shows the border twice
}

glm::vec3 texel(const Image<float>& image, int x, int y) {
  const float* p = image.pixel(x, y);
  return image.channels == 3 ? glm::vec3(p[0], p[1], p[2]) : glm::vec3(p[0]);
}

// uv: from the picture's upper left corner.
glm::vec3 bilinear(const Image<float>& image, glm::vec2 uv, const SurfaceTexture::Wraps& wraps) {
  const float x = uv.x * float(image.width) - 0.5f, y = uv.y * float(image.height) - 0.5f;
  const float left = std::floor(x), top = std::floor(y);
  const auto column = [&](int i) { return wrapped(i, image.width, wraps[0]); };
  const auto row = [&](int i) { return wrapped(i, image.height, wraps[1]); };
  const int x0 = column(int(left)), x1 = column(int(left) + 1);
  const int y0 = row(int(top)), y1 = row(int(top) + 1);
  const glm::vec3 upper = glm::mix(texel(image, x0, y0), texel(image, x1, y0), x - left);
  const glm::vec3 lower = glm::mix(texel(image, x0, y1), texel(image, x1, y1), x - left);
  return glm::mix(upper, lower, y - top);
}

}  // namespace

std::string_view name(Wrap wrap) { return kWraps[std::size_t(wrap)]; }

Wrap wrap_mode(std::string_view name) {
  const auto found = std::find(kWraps.begin(), kWraps.end(), name);
  check(found != kWraps.end(), "a texture's wrap must be repeat, clamp or mirror, got ", name);
  return Wrap(found - kWraps.begin());
}

SurfaceTexture::SurfaceTexture(Image<float> image, Wraps wraps) : wraps_(wraps) {
  image.validate();
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
  uv = glm::vec2(folded(uv.x, wraps_[0]), 1 - folded(uv.y, wraps_[1]));
  const float clamped = level > 0 ? std::min(level, float(level_count() - 1)) : 0.0f;
  const int k = int(clamped);
  const glm::vec3 fine = bilinear(levels_[std::size_t(k)], uv, wraps_);
  if (clamped == float(k)) return fine;
  return glm::mix(fine, bilinear(levels_[std::size_t(k) + 1], uv, wraps_), clamped - float(k));
}

float SurfaceTexture::level_of(glm::vec2 uv_dx, glm::vec2 uv_dy) const {
  return shared::texture_level(glm::vec2(width(), height()), uv_dx, uv_dy);
}

}  // namespace fastibl
