#include "demo/simulator/surface.h"

#include <cmath>

namespace fastibl::demo {

void paint(Surface& surface, const std::function<Paint(float, float)>& at) {
  const int width = int(std::lround(surface.size.x * surface.density));
  const int height = int(std::lround(surface.size.y * surface.density));
  surface.albedo = Image<float>(width, height, 4), surface.emission = surface.albedo;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const Paint paint =
          at((float(x) + 0.5f) / surface.density, (float(y) + 0.5f) / surface.density);
      for (int c = 0; c < 3; ++c) {
        surface.albedo.pixel(x, y)[c] = paint.albedo[c];
        surface.emission.pixel(x, y)[c] = paint.emission[c];
      }
    }
}

}  // namespace fastibl::demo
