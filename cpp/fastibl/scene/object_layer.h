// The shaded object as a layer over the back picture.
#pragma once

#include "fastibl/core/image.h"

namespace fastibl {

// Linear radiance times coverage (RGB), and coverage (A), in the rectangle [x, x + width) × [y, y +
// height) of the picture; elsewhere nothing.
struct ObjectLayer {
  int x = 0, y = 0;
  Image<float> rgba{0, 0, 4};
  bool operator==(const ObjectLayer&) const = default;
};

}  // namespace fastibl
