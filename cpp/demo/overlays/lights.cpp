#include <algorithm>
#include <cmath>

#include "demo/overlays/format.h"
#include "demo/overlays/overlay.h"
#include "fastibl/scene/main_lights.h"

namespace fastibl::demo {
namespace {

constexpr std::size_t kMost = 5;  // lights that are listed
constexpr double kLength = 0.12;  // of an arrow, metres

Colour colour_of(const glm::vec3& light) {
  const glm::vec3 c = light / std::max({light.x, light.y, light.z, 1e-9f});
  const auto encoded = [](float v) { return int(255 * std::pow(v, 1 / 2.2f)); };
  return {encoded(c.x), encoded(c.y), encoded(c.z)};
}

std::string told(std::size_t number, const MainLight& light, const glm::vec3& centre) {
  const double up = std::asin(double(light.direction.z)) / kDegree;
  std::string text = std::to_string(number + 1) + ": " + fixed(100 * light.share, 0) + " %, " +
                     fixed(up, 0) + " deg up, " +
                     fixed(2 * double(light.angular_radius) / kDegree, 0) + " deg wide";
  if (light.place)
    text += ", " + fixed(glm::length(light.place->position - glm::dvec3(centre)), 1) + " m";
  return text;
}

}  // namespace

void draw_lights(Canvas& canvas, const View& view) {
  if (!view.result.environment)
    return canvas.panel(Corner::top_right, {{"lights: no map yet", kOrange}});
  std::vector<MainLight> lights = main_lights(*view.result.environment);
  if (lights.size() > kMost) lights.resize(kMost);
  const glm::vec3 centre(view.session.capture().centre());
  const Lens lens(view.rig.back);
  std::vector<Line> lines = {
      {lights.empty() ? "lights: none stands out" : "lights: share of a plane that faces them",
       kGrey}};
  for (std::size_t k = 0; k < lights.size(); ++k) {
    lines.push_back({told(k, lights[k], centre), colour_of(lights[k].irradiance)});
    if (!view.result.back_from_marker) continue;
    const glm::dvec3 from(centre), to = from + kLength * glm::dvec3(lights[k].direction);
    const auto a = lens.project(*view.result.back_from_marker * from);
    const auto b = lens.project(*view.result.back_from_marker * to);
    if (!a || !b) continue;
    canvas.arrow(*a, *b, {0, 0, 0}, 4);
    canvas.arrow(*a, *b, colour_of(lights[k].irradiance), 2);
    canvas.text(glm::ivec2(*b) + 3, std::to_string(k + 1), kYellow);
  }
  canvas.panel(Corner::top_right, lines);
}

}  // namespace fastibl::demo
