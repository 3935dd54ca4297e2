#include <cmath>
#include <string>

#include "demo/overlays/equirect.h"
#include "demo/overlays/format.h"
#include "demo/overlays/overlay.h"
#include "fastibl/capture/next_view.h"
#include "fastibl/lighting/harmonic_sums.h"

namespace fastibl::demo {
namespace {

constexpr int kTexels = 32;  // along a face's edge, at the map's level that is summed

// Irradiance on the table, as the mean over RGB: a number to compare maps by.
double table_light(const CubeMap& map) {
  const glm::dvec3 irradiance = plane_irradiance(fold(map, kTexels));
  return (irradiance.x + irradiance.y + irradiance.z) / 3;
}

// Such as "turn 40 deg left, 20 deg up".
std::string way(const glm::dvec3& direction, const Pose& camera_from_marker) {
  const glm::dvec3 d = camera_from_marker.rotation * direction;
  const double right = std::atan2(d.x, d.z) / kDegree;
  const double up = std::atan2(-d.y, std::hypot(d.x, d.z)) / kDegree;
  std::string text;
  const auto add = [&](double by, const char* plus, const char* minus) {
    if (std::abs(by) < 5) return;
    text += (text.empty() ? "turn " : ", ") + std::to_string(std::lround(std::abs(by))) + " deg " +
            (by > 0 ? plus : minus);
  };
  add(right, "right", "left"), add(up, "up", "down");
  return text.empty() ? "hold still" : text;
}

// The lines under the map, as narrow as its inset.
std::vector<Line> told(const View& view, const NextView& next) {
  const Environment& environment = *view.result.environment;
  std::vector<Line> lines = {
      {"map: " + fixed(100 * next.seen, 0) + " % of the sky seen,"},
      {"its light is off by about " + fixed(100 * environment.predicted_error, 0) + " %,"},
      {"by " + fixed(100 * environment.predicted_low, 0) + " to " +
       fixed(100 * environment.predicted_high, 0) + " % 9 times in 10"}};
  if (view.true_light) {
    const double off = table_light(environment.radiance) / table_light(*view.true_light) - 1;
    lines.push_back({fixed(100 * off, 1) + " % by the true map, below"});
  }
  if (!next.direction) lines.push_back({"all of the sky was seen", kGreen});
  return lines;
}

}  // namespace

void draw_map(Canvas& canvas, const View& view) {
  const int height = std::max(8, std::min(canvas.height() / 5, canvas.width() / 5));
  const double exposure = view.frame.back_exposure.value_or(1) / 2;
  if (view.true_light)
    if (const auto at = canvas.take(Corner::bottom_right, 2 * height, height))
      draw_equirect(canvas, {*at, height}, *view.true_light, {}, exposure);
  if (!view.result.environment)
    return canvas.panel(Corner::bottom_right, {{"no map yet", kOrange}});
  const std::optional<Pose>& pose = view.result.back_from_marker;
  std::optional<Pose> front;
  if (pose && view.rig.front) front = view.rig.front_from_back * *pose;
  const std::optional<Pose>& turning = view.rig.front ? front : pose;
  std::optional<glm::dvec3> looking;
  if (turning) looking = glm::transpose(turning->rotation)[2];
  const NextView next = next_view(*view.result.environment, looking);
  std::vector<Line> lines = told(view, next);
  if (next.direction && turning) {
    lines.push_back(
        {std::string("look there with the ") + (front ? "front" : "back") + " camera:", kOrange});
    lines.push_back({way(*next.direction, *turning), kOrange});
  }
  if (const auto at = canvas.take(Corner::bottom_right, 2 * height, height)) {
    const Inset inset{*at, height};
    const Environment& environment = *view.result.environment;
    draw_equirect(canvas, inset, environment.radiance, environment.confidence(), exposure);
    if (pose) draw_field(canvas, inset, view.rig.back, *pose, kWhite);
    if (front) draw_field(canvas, inset, *view.rig.front, *front, kBlue);
    if (next.direction) {
      const glm::dvec3& target = *next.direction;
      if (turning) draw_way(canvas, inset, *looking, target, kOrange);
      canvas.circle(in_equirect(inset, target), height / 16.0, kOrange, 2);
    }
  }
  canvas.panel(Corner::bottom_right, lines);
}

}  // namespace fastibl::demo
