#include <cmath>

#include "demo/overlays/format.h"
#include "demo/overlays/overlay.h"

namespace fastibl::demo {
namespace {

constexpr double kAxis = 0.08;  // metres

void draw_segment(Canvas& canvas, const Lens& lens, const glm::dvec3& a, const glm::dvec3& b,
                  Colour colour, int thickness) {
  const auto from = lens.project(a), to = lens.project(b);
  if (from && to) canvas.line(*from, *to, colour, thickness);
}

void draw_axes(Canvas& canvas, const Lens& lens, const Pose& camera_from_marker) {
  constexpr Colour kColours[] = {kRed, kGreen, kBlue};
  for (int k = 0; k < 3; ++k) {
    glm::dvec3 tip(0);
    tip[k] = kAxis;
    draw_segment(canvas, lens, camera_from_marker * glm::dvec3(0), camera_from_marker * tip,
                 kColours[k], 2);
  }
}

void draw_page(Canvas& canvas, const View& view, const Lens& lens, const Pose& camera_from_marker) {
  if (!view.board) return;
  const double x = view.board->width / 2, y = view.board->height / 2;
  const glm::dvec3 corners[] = {{-x, -y, 0}, {x, -y, 0}, {x, y, 0}, {-x, y, 0}};
  for (int k = 0; k < 4; ++k)
    draw_segment(canvas, lens, camera_from_marker * corners[k],
                 camera_from_marker * corners[(k + 1) % 4], kGrey, 1);
}

}  // namespace

void draw_pose(Canvas& canvas, const View& view) {
  const std::optional<Pose>& pose = view.result.back_from_marker;
  if (!pose) {
    std::string text = "the board is not in view";
    if (view.result.turned) text += "; the surroundings tell the rotation";
    return canvas.panel(Corner::bottom_left, {{text, kOrange}});
  }
  if (view.result.tracked)
    for (const DetectedTag& tag : view.result.tracked->tags)
      for (std::size_t k = 0; k < 4; ++k)
        canvas.line(tag.corners[k], tag.corners[(k + 1) % 4], kYellow);
  const Lens lens(view.rig.back);
  draw_page(canvas, view, lens, *pose);
  draw_axes(canvas, lens, *pose);
  const glm::dvec3 eye = pose->inverse().translation;
  const double tilt = std::acos(eye.z / glm::length(eye)) / kDegree;
  std::vector<Line> lines = {
      {"camera " + fixed(glm::length(eye), 3) + " m away, tilted " + fixed(tilt, 0) + " deg"}};
  if (const std::optional<Tracked>& tracked = view.result.tracked) {
    lines.push_back({std::to_string(tracked->tags.size()) + " tags, " +
                     std::to_string(tracked->edges) + " edges, off by " +
                     fixed(tracked->residual_px, 2) + " px"});
    if (tracked->ambiguous) lines.push_back({"the mirrored pose fits nearly as well", kOrange});
  } else {
    lines.push_back({"the pose was given", kGrey});
  }
  if (view.result.board_moved) lines.push_back({"the board was moved", kOrange});
  canvas.panel(Corner::bottom_left, lines);
}

}  // namespace fastibl::demo
