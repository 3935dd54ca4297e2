#include "fastibl/capture/surroundings.h"

#include <algorithm>
#include <cmath>

#include "fastibl/capture/texel_view.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {
namespace {

// Standard deviations of a light's distance. Within these it counts as being where everything is
// thought to be, as told by somebody who may know better.
constexpr double kAgreed = 2;
// Share of a distance, and angle: what moved by less counts as the same.
constexpr float kChange = 0.03f;

bool is_about(const Depth& a, const Depth& b) {
  const float most = std::max(a.inverse_distance, b.inverse_distance);
  return std::abs(a.inverse_distance - b.inverse_distance) <= kChange * most &&
         glm::length(a.light - b.light) * most <= kChange;
}

}  // namespace

Surroundings::Surroundings(const TileOutlines& outlines, const MapSurface& surface)
    : surface_(surface) {
  usual_.inverse_distance = float(1 / surface.distance()), usual_.box = surface.box().has_value();
  for (int side = 0; side < 2; ++side) walls_[side] = glm::vec3(surface.walls()[side]);
  const std::size_t padded = outlines.bulge.size();
  depths_.assign(padded, usual_);
  for (int c = 0; c < 4; ++c) corners_[c].assign(padded, 0.0f);
  for (int tile = 0; tile < outlines.grid.count(); ++tile) set(outlines, tile, usual_);
  near_ = surface_.is_near();
}

float Surroundings::weight(const glm::vec3& d, const Depth& depth) const {
  if (!depth.box) return depth.inverse_distance * glm::length(d);
  const glm::vec3 along(along_walls(d, surface_.walls_axis()));
  const glm::vec3 most = glm::max(along * walls_[0], along * walls_[1]);
  return std::max(most.x, std::max(most.y, most.z));
}

void Surroundings::set(const TileOutlines& outlines, int tile, const Depth& depth) {
  const std::size_t i = std::size_t(tile);
  depths_[i] = depth;
  for (int c = 0; c < 4; ++c) {
    const TileOutlines::Corner& from = outlines.corners[c];
    corners_[c][i] = weight({from.x[i], from.y[i], from.z[i]}, depth);
  }
}

std::vector<int> Surroundings::place(const TileOutlines& outlines,
                                     std::span<const LightPosition> lights) {
  struct Placed {
    glm::dvec3 direction;
    double radius;
    Depth depth;
  };
  std::vector<Placed> placed;
  const bool had_lights = !lights_.empty();
  lights_.clear();
  for (const LightPosition& light : lights) {
    const glm::dvec3 offset = light.position - surface_.centre();
    const double distance = glm::length(offset);
    const glm::dvec3 towards = offset / distance;
    const double deviation = std::sqrt(glm::dot(towards, light.covariance * towards));
    if (gap(light) * distance * distance < kAgreed * deviation) continue;
    lights_.push_back(light);
    placed.push_back({towards,
                      angular_radius(light, surface_.centre()),
                      {float(1 / distance), false, glm::vec3(offset)}});
  }
  if (placed.empty() && !had_lights) return {};
  std::vector<int> changed;
  for (int tile = 0; tile < outlines.grid.count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    if (outlines.above[i] == 0) continue;
    const glm::dvec3 middle = outlines.middle(tile);
    const double reach = outlines.reach(tile);
    Depth depth = usual_;
    double nearest = 1e30;  // from the light's rim, radians
    for (const Placed& light : placed) {
      const double angle = std::acos(std::clamp(glm::dot(light.direction, middle), -1.0, 1.0));
      if (angle > light.radius + reach || angle - light.radius >= nearest) continue;
      nearest = angle - light.radius, depth = light.depth;
    }
    const Depth& old = depths_[i];
    if (depth == old) continue;
    if (depth.box == old.box && is_about(depth, old)) continue;
    set(outlines, tile, depth);
    changed.push_back(tile);
  }
  near_ = surface_.is_near() || !placed.empty();
  find_lit();
  return changed;
}

void Surroundings::find_lit() {
  lit_.clear();
  for (std::size_t i = 0; i < depths_.size(); ++i) {
    const glm::vec3& light = depths_[i].light;
    if (light == glm::vec3(0)) continue;
    auto known = std::find_if(lit_.begin(), lit_.end(),
                              [&](const LitTiles& lit) { return lit.light == light; });
    if (known == lit_.end())
      known = lit_.insert(lit_.end(), {light, std::vector<float>(depths_.size(), 0.0f)});
    known->tiles[i] = 1;
  }
}

double Surroundings::gap(const LightPosition& light) const {
  return std::abs(1 / glm::length(light.position - surface_.centre()) -
                  surface_.nearness(light.direction));
}

}  // namespace fastibl
