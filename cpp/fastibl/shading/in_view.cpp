#include "fastibl/shading/in_view.h"

#include <array>
#include <utility>

#include "fastibl/shading/cut_polygon.h"

namespace fastibl {
namespace {

// Corners of a box's faces, as Bounds::corners() numbers them.
constexpr std::array<std::array<std::size_t, 4>, 6> kFaces = {
    {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}}};

glm::dvec3 crossing(const glm::dvec3& inner, const glm::dvec3& outer, double inside,
                    double outside) {
  return glm::mix(inner, outer, inside / (inside - outside));
}

}  // namespace

bool PictureView::meets(std::vector<glm::dvec3> polygon) const {
  std::vector<glm::dvec3> kept;
  const auto cut = [&](const ViewPlane& plane) {
    cut_polygon(
        polygon, kept, [&](const glm::dvec3& p) { return plane.at(p); }, crossing);
  };
  cut({{0, 0, 1}, 0});  // before the camera
  for (const ViewPlane& side : sides_) cut(side);
  return !polygon.empty();
}

bool PictureView::may_show(const Bounds& box, const Pose& camera_from_box) const {
  std::array<glm::dvec3, 8> corners;
  const std::array<glm::vec3, 8> own = box.corners();
  for (std::size_t i = 0; i < 8; ++i) corners[i] = camera_from_box * glm::dvec3(own[i]);
  for (const auto& face : kFaces) {
    std::vector<glm::dvec3> polygon;
    for (const std::size_t i : face) polygon.push_back(corners[i]);
    if (meets(std::move(polygon))) return true;
  }
  return false;
}

bool PictureView::may_show(glm::vec2 centre, float extent, const Pose& camera_from_plane) const {
  std::vector<glm::dvec3> square;
  for (const glm::dvec2 side : {glm::dvec2(-1, -1), {1, -1}, {1, 1}, {-1, 1}})
    square.push_back(camera_from_plane * glm::dvec3(glm::dvec2(centre) + double(extent) * side, 0));
  return meets(std::move(square));
}

}  // namespace fastibl
