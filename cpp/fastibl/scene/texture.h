// Pictures on surfaces: linear values with a MIP chain.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// What lies beyond the picture along one axis: the picture again, its border, or its mirror image.
enum class Wrap { repeat, clamp, mirror };
std::string_view name(Wrap wrap);
Wrap wrap_mode(std::string_view name);  // throws std::invalid_argument for an unknown name

// uv (0, 0) is the lower left corner of the picture, whose row 0 is at v = 1.
class SurfaceTexture {
 public:
  using Wraps = std::array<Wrap, 2>;  // along u and v
  // The image has 1 or 3 channels. Throws for an empty image, another number of channels, fields
  // that disagree, or values that are not finite.
  explicit SurfaceTexture(Image<float> image, Wraps wraps = {Wrap::repeat, Wrap::repeat});

  int width() const { return levels_[0].width; }
  int height() const { return levels_[0].height; }
  const Wraps& wraps() const { return wraps_; }
  int channels() const { return levels_[0].channels; }
  int level_count() const { return int(levels_.size()); }
  // Each level is the 2×2 mean of the next finer one, or of a little more where that has an odd
  // size: the mean of all texels stays the same.
  const Image<float>& level(int k) const { return levels_[std::size_t(k)]; }

  glm::vec3 largest() const { return largest_; }  // of each channel

  // Trilinear look-up; a single channel is given three times.
  glm::vec3 sample(glm::vec2 uv, float level) const;
  // The level whose texels are as large as the longer of the two uv steps from pixel to pixel.
  float level_of(glm::vec2 uv_dx, glm::vec2 uv_dy) const;
  bool operator==(const SurfaceTexture&) const = default;

 private:
  std::vector<Image<float>> levels_;
  Wraps wraps_;
  glm::vec3 largest_{0};
};

}  // namespace fastibl
