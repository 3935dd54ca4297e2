#include "fastibl/shadow/near_plane.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/simd.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

constexpr float kLowest = 1e-3f;  // of a_z: a light there grazes the plane
constexpr float kSameDistance = 0.005f, kSameDirection = 0.0045f;  // relative; radians

}  // namespace

int NearPlane::light_of(glm::vec3 direction) const {
  const NearLight* light = near_lights_.towards(direction);
  if (!light || !(light->inverse_distance > 0)) return -1;
  if (!(direction.z + light->inverse_distance * near_lights_.centre.z > kLowest)) return -1;
  return int(light - near_lights_.lights.data());
}

PlaneProjection NearPlane::projection(glm::vec3 direction, int i, glm::vec2 shift) const {
  const float rho = near_lights_.lights[std::size_t(i)].inverse_distance;
  const glm::vec3 a = direction + rho * (near_lights_.centre - glm::vec3(shift, 0));
  return {glm::vec2(a) / a.z, rho / a.z};
}

glm::dvec3 NearPlane::position(glm::vec3 direction, int i) const {
  const double rho = near_lights_.lights[std::size_t(i)].inverse_distance;
  return glm::dvec3(near_lights_.centre) + glm::dvec3(direction) / rho;
}

float NearPlane::height(glm::vec3 direction, int i) const {
  const float rho = near_lights_.lights[std::size_t(i)].inverse_distance;
  return (direction.z + rho * near_lights_.centre.z) / std::max(direction.z, kLowest);
}

namespace {

// at: near_arrow() at the origin. Distances below √least, and the NaN of a point as far as floats
// reach, count as √least.
FASTIBL_CLONES
void falloff_of(glm::vec3 at, float inverse_distance, float least, const glm::vec2* points,
                std::size_t count, float* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const float x = at.x - inverse_distance * points[i].x,
                y = at.y - inverse_distance * points[i].y;
    const float square = x * x + y * y + at.z * at.z, length2 = square > least ? square : least;
    out[i] = 1 / (length2 * std::sqrt(length2));
  }
}

}  // namespace

void NearPlane::falloff(int i, std::span<const glm::vec2> points, std::span<float> out) const {
  const NearLight& light = near_lights_.lights[std::size_t(i)];
  const glm::vec3 at =
      shared::near_arrow(light.direction, light.inverse_distance, -near_lights_.centre);
  // Nothing is nearer than the light's surface, nor than a ten-thousandth of its distance.
  const float least = std::max(light.sin_radius * light.sin_radius, 1e-8f);
  falloff_of(at, light.inverse_distance, least, points.data(), points.size(), out.data());
}

bool NearPlane::still_right(const NearLights& others) const {
  if (others.lights.size() != near_lights_.lights.size()) return false;
  if (others.lights.empty()) return true;
  if (others.centre != near_lights_.centre) return false;
  for (std::size_t i = 0; i < others.lights.size(); ++i) {
    const NearLight &a = near_lights_.lights[i], &b = others.lights[i];
    if (std::fabs(a.inverse_distance - b.inverse_distance) > kSameDistance * a.inverse_distance)
      return false;
    if (!(glm::length(a.direction - b.direction) <= kSameDirection)) return false;
  }
  return true;
}

}  // namespace fastibl
