#include <algorithm>
#include <cmath>

#include "demo/overlays/format.h"
#include "demo/overlays/overlay.h"

namespace fastibl::demo {

void draw_shadow_map(Canvas& canvas, const View& view) {
  const ShadowMap map = view.session.shadow_map();
  if (map.ratio.empty()) return canvas.panel(Corner::bottom_left, {{"no shadow yet", kOrange}});
  const int size = std::max(8, canvas.height() / 4);
  const auto at = canvas.take(Corner::bottom_left, size, size);
  if (!at) return;
  // Shows twice the finer map's extent: beyond that there is hardly any shadow.
  const float reach = std::min(2 * map.extent, map.reach());
  std::vector<glm::vec2> points;
  for (int k = 0; k < size * size; ++k) {
    const glm::vec2 pixel((float(k % size) + 0.5f), float(size) - (float(k / size) + 0.5f));
    points.push_back(map.centre + (2.0f / float(size) * pixel - 1.0f) * reach);
  }
  std::vector<glm::vec3> ratios(points.size());
  map.sample(points, ratios);
  float least = 1;
  for (int k = 0; k < size * size; ++k) {
    const glm::vec3 ratio = glm::clamp(ratios[std::size_t(k)], 0.0f, 1.0f);
    least = std::min(least, (ratio.x + ratio.y + ratio.z) / 3);
    std::uint8_t* pixel = canvas.pixel(at->x + k % size, at->y + k / size);
    for (int c = 0; c < 3; ++c) pixel[c] = std::uint8_t(std::lround(255 * ratio[c]));
  }
  const glm::dvec2 middle = glm::dvec2(*at) + size / 2.0;
  canvas.line(middle - glm::dvec2(4, 0), middle + glm::dvec2(4, 0), kOrange);
  canvas.line(middle - glm::dvec2(0, 4), middle + glm::dvec2(0, 4), kOrange);
  canvas.panel(Corner::bottom_left, {{"shadow: " + fixed(2 * double(reach), 2) +
                                      " m wide, darkest " + fixed(double(least), 2)}});
}

}  // namespace fastibl::demo
