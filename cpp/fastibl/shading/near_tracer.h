// The light of near lights at places between the vertices of an object, by rays to where they are.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "fastibl/scene/bvh.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/light_sums.h"
#include "fastibl/shading/near_shares.h"

namespace fastibl {

// The brightest of the near lights, in their order. Keeps references.
class NearTracer {
 public:
  static constexpr int kMost = 7;   // lights; others are left to the vertices
  static constexpr int kRays = 32;  // to a light
  static constexpr int kFirst = 8;  // that tell whether it is hidden in part

  NearTracer(const Scene& scene, const NearShares& shares);

  struct Light {
    glm::vec3 direction;  // from the map's centre, mesh's frame
    float inverse_distance, sin_radius;
    glm::vec3 irradiance;
    const NearShares::OfLight* of;
  };
  const std::vector<Light>& lights() const { return lights_; }
  glm::vec3 centre() const { return centre_; }  // of the map, mesh's frame

  // What entries agree on of a light from places between them; mixed: on nothing.
  using Entries = std::array<std::size_t, 3>;
  NearState between(const Light& light, const Entries& entries) const;

  struct Place {
    glm::vec3 normal;                   // unit, mesh's frame
    std::span<const glm::vec3> starts;  // of rays: one, or kStarts over a pixel
    const Entries& entries;
    glm::vec3 weights;                           // of the entries
    const std::array<glm::vec3, 4>& irradiance;  // of them and of the place, nothing hidden
    const std::array<glm::vec3, 3>& own;         // shares of the map alone that they have
  };
  static constexpr std::size_t kStarts = 4;
  // Whether normals turn so much between entries that what is interpolated is off: θ²/8 of the
  // light, 0.4 %.
  static constexpr float kBent = 0.985f;  // cosine of θ
  bool bent(const Entries& entries) const;
  // The part of a light that nothing hides, among what lies above the tangent plane, where it is
  // and where the map has it; by rays where the entries do not agree, or always. Adds up the rays
  // that it traced.
  float open(const Light& light, const Place& place, int& rays) const;
  float open_in_map(const Light& light, const Place& place, int& rays) const {
    return open_part(light, place, light.direction, rays);
  }
  // What these lights (a bit for each) change of the share of its irradiance that reaches the
  // place, by channel, less what is interpolated between the entries. By light: the part of it that
  // is open, and the part that is lost where the map has it.
  glm::vec3 change(const Place& place, std::uint32_t asked, std::span<const float> open,
                   std::span<const float> lost) const;
  // A light of this flux in a lobe at a place, with nothing hidden.
  float in_lobe(const Light& light, float flux, const Place& place, glm::vec3 view,
                const LobeHeight& lobe) const;

 private:
  float open_part(const Light& light, const Place& place, glm::vec3 arrow, int& rays) const;
  glm::vec3 arrow(const Light& light, const Place& place) const;

  const Bvh& bvh_;
  std::span<const glm::vec3> normals_;
  glm::vec3 centre_;
  std::vector<Light> lights_;
};

}  // namespace fastibl
