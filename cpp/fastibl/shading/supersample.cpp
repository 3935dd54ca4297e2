#include "fastibl/shading/supersample.h"

#include <algorithm>
#include <utility>

#include "fastibl/core/check.h"

namespace fastibl {
namespace {

// The layer with room for these rows and columns as well; what is new is empty.
void extend(ObjectLayer& layer, int left, int top, int right, int bottom) {
  const bool empty = layer.rgba.empty();
  const int x0 = empty ? left : std::min(layer.x, left), y0 = empty ? top : std::min(layer.y, top);
  const int x1 = empty ? right : std::max(layer.x + layer.rgba.width, right);
  const int y1 = empty ? bottom : std::max(layer.y + layer.rgba.height, bottom);
  ObjectLayer larger{x0, y0, Image<float>(x1 - x0, y1 - y0, 4)};
  for (int y = 0; y < layer.rgba.height; ++y)
    std::copy_n(layer.rgba.pixel(0, y), 4 * layer.rgba.width,
                larger.rgba.pixel(layer.x - x0, layer.y + y - y0));
  layer = std::move(larger);
}

}  // namespace

Camera enlarged(const Camera& camera, int scale) {
  check(scale >= 1 && scale <= kMostSupersampling, "supersampling must be from 1 to ",
        kMostSupersampling, ", got ", scale);
  Camera large = camera;
  large.width *= scale, large.height *= scale;
  large.fx *= scale, large.fy *= scale, large.cx *= scale, large.cy *= scale;
  return large;
}

std::vector<Strip> strips_of(const Camera& camera, int scale) {
  const Camera large = enlarged(camera, scale);
  constexpr int kPixels = 1 << 20;
  const int rows = std::max(1, kPixels / (camera.width * scale * scale));
  std::vector<Strip> strips;
  for (int top = 0; top < camera.height; top += rows) {
    Strip strip{scale, top, large};
    strip.camera.height = std::min(rows, camera.height - top) * scale;
    strip.camera.cy -= double(top) * scale;
    strips.push_back(std::move(strip));
  }
  return strips;
}

void add_strip(const Strip& strip, const ObjectLayer& large, ObjectLayer& layer) {
  if (large.rgba.empty()) return;
  const int n = strip.scale;
  const int left = large.x / n, top = strip.top + large.y / n;
  const int right = (large.x + large.rgba.width - 1) / n + 1;
  const int bottom = strip.top + (large.y + large.rgba.height - 1) / n + 1;
  extend(layer, left, top, right, bottom);
  const float part = 1 / float(n * n);
  for (int y = 0; y < large.rgba.height; ++y)
    for (int x = 0; x < large.rgba.width; ++x) {
      const float* from = large.rgba.pixel(x, y);
      float* to =
          layer.rgba.pixel((large.x + x) / n - layer.x, strip.top + (large.y + y) / n - layer.y);
      for (int c = 0; c < 4; ++c) to[c] += part * from[c];
    }
}

}  // namespace fastibl
