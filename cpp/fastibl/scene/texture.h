// Pictures on surfaces: linear values with a MIP chain.
#pragma once

#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// uv (0, 0) is the lower left corner of the picture, whose row 0 is at v = 1; it repeats.
class SurfaceTexture {
 public:
  // Of 1 or 3 channels; throws for an empty one, another number, or values that are not finite.
  explicit SurfaceTexture(Image<float> image);

  int width() const { return levels_[0].width; }
  int height() const { return levels_[0].height; }
  int channels() const { return levels_[0].channels; }
  int level_count() const { return int(levels_.size()); }
  // Each level is the 2×2 mean of the one above; where that has an odd width, of all but its last.
  const Image<float>& level(int k) const { return levels_[std::size_t(k)]; }

  glm::vec3 largest() const { return largest_; }  // of each channel

  // Trilinear; one channel is given three times.
  glm::vec3 sample(glm::vec2 uv, float level) const;
  // The level whose texels are as large as the longer of the two steps of uv from pixel to pixel.
  float level_of(glm::vec2 uv_dx, glm::vec2 uv_dy) const;
  bool operator==(const SurfaceTexture&) const = default;

 private:
  std::vector<Image<float>> levels_;
  glm::vec3 largest_{0};
};

}  // namespace fastibl
