// A picture in linear light at several sizes, for reading it with a footprint.
#pragma once

#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

// Value under a footprint: linear RGB (exposure included), and the share of clipped pixels a
// channel.
struct FootprintSample {
  glm::vec3 linear{0};
  glm::vec3 clipped{0};
};

class FramePyramid {
 public:
  FramePyramid(const Picture& picture, const Response& response);

  // Mean around a pixel position over about `width` × `width` pixels, by trilinear look-up.
  FootprintSample sample(float x, float y, float width) const;

 private:
  static constexpr int kFirst = 1;  // levels start at half size: a cube texel covers several pixels
  std::vector<Image<float>> levels_;  // six channels: linear, clipped
};

}  // namespace fastibl
