#include "fastibl/capture/texel_view.h"

#include <algorithm>
#include <cmath>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

TexelView::TexelView(const Camera& camera, const Pose& camera_from_marker,
                     const Viewpoint& viewpoint)
    : camera_(camera),
      lens_(camera),
      viewpoint_(viewpoint),
      rotation_(camera_from_marker.rotation),
      centre_(camera_from_marker * viewpoint.centre),
      height_(camera_from_marker.inverse().translation.z),
      nearness_(1 / viewpoint.distance),
      axis_(glm::transpose(camera_from_marker.rotation)[2]) {
  double widest = 0;
  for (const glm::dvec2 corner :
       {glm::dvec2(0, 0), glm::dvec2(camera.width, 0), glm::dvec2(0, camera.height),
        glm::dvec2(camera.width, camera.height)}) {
    const auto ray = lens_.unproject(corner);
    widest =
        std::max(widest, ray ? std::atan(glm::length(glm::dvec2(*ray))) : std::numbers::pi / 2);
  }
  // What is near is seen in another direction than from the viewpoint.
  const double parallax = std::asin(std::min(1.0, nearness_ * glm::length(centre_)));
  reach_ = float(widest + parallax);
}

std::optional<Sighting> TexelView::see(const glm::dvec3& d, double solid_angle) const {
  const glm::dvec3 turned = rotation_ * d;
  glm::dvec3 seen;  // in the camera frame; its length is free above the horizon
  double share;     // of the texel's solid angle: that under which the camera sees it
  if (d.z >= 0) {
    seen = turned + nearness_ * centre_;
    const double length2 = glm::dot(seen, seen);
    share = std::abs(glm::dot(turned, seen)) / (length2 * std::sqrt(length2));
  } else {
    // The plane hides what is under it, and its underside is not the table.
    if (height_ <= 0) return std::nullopt;
    const double distance = viewpoint_.centre.z / -d.z;
    const glm::dvec3 point = viewpoint_.centre + distance * d;
    if (std::abs(point.x) < viewpoint_.masked.x && std::abs(point.y) < viewpoint_.masked.y)
      return std::nullopt;
    seen = centre_ + distance * turned;
    const double length2 = glm::dot(seen, seen);
    share = distance * distance / length2 * height_ / (std::sqrt(length2) * -d.z);
  }
  const auto pixel = lens_.project(seen);
  if (!pixel || !camera_.inside(*pixel)) return std::nullopt;
  // Solid angle times f² over cos³ of the angle to the optical axis.
  const double cosine = seen.z / glm::length(seen);
  return Sighting{
      *pixel, float(share * solid_angle * camera_.fx * camera_.fy / (cosine * cosine * cosine))};
}

bool TexelView::may_see(int face, int x0, int y0, int x1, int y1, int size) const {
  const auto corner = [&](int x, int y) {
    return glm::normalize(face_direction(face, float(x) / float(size), float(y) / float(size)));
  };
  const glm::vec3 corners[4] = {corner(x0, y0), corner(x1, y0), corner(x0, y1), corner(x1, y1)};
  const glm::vec3 middle = glm::normalize(corners[0] + corners[1] + corners[2] + corners[3]);
  float cosine = 1, lowest = 1;
  for (const glm::vec3& c : corners)
    cosine = std::min(cosine, glm::dot(c, middle)), lowest = std::min(lowest, c.z);
  if (lowest < 0) return true;  // the plane is near: no direction bounds where the camera sees it
  return std::acos(std::clamp(glm::dot(middle, axis_), -1.0f, 1.0f)) <= reach_ + std::acos(cosine);
}

}  // namespace fastibl
