#include "fastibl/shading/near_shares.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

constexpr int kGrain = 256;  // vertices
// Of a light's disc at which the object is looked for: at most, and of two cells.
constexpr int kMostPoints = 16;
constexpr float kPointArea = 2;

// What is free around one vertex.
class FreeCells {
 public:
  FreeCells(const VertexVisibility& visibility, std::size_t vertex)
      : begin_(visibility.edges.data() + visibility.first[vertex]),
        end_(visibility.edges.data() + visibility.first[vertex + 1]) {}
  bool all() const { return begin_ == end_; }
  // Between the middles of four cells.
  float share(const OctahedralGrid::Corners& corners) const {
    float free = 0;
    for (int k = 0; k < 4; ++k)
      if ((std::upper_bound(begin_, end_, corners.cells[k]) - begin_) % 2 == 0)
        free += corners.shares[k];
    return free;
  }

 private:
  const std::uint16_t *begin_, *end_;
};

// Part of a light's disc that is free, of what lies above the tangent plane. All in the frame of
// the object; towards: unit.
float free_part(const FreeCells& cells, const OctahedralGrid& grid, glm::vec3 normal,
                glm::vec3 towards, float sin_radius) {
  if (cells.all()) return 1;
  const float cell = std::sqrt(4 * kPi) / float(grid.size());
  const float across = 2 * std::asin(std::min(sin_radius, 1.0f)) / cell;
  const int count = std::clamp(int(std::ceil(across * across / kPointArea)), 1, kMostPoints);
  if (count == 1) return cells.share(grid.around(towards));
  const glm::vec3 other = std::fabs(towards.x) < 0.7f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0);
  const glm::vec3 right = glm::normalize(glm::cross(other, towards)),
                  up = glm::cross(towards, right);
  float free = 0;
  int seen = 0;
  for (int i = 0; i < count; ++i) {  // a sunflower's seeds: even over the disc
    const float radius = sin_radius * std::sqrt((float(i) + 0.5f) / float(count));
    const float turn = float(i) * 2.39996323f;
    const glm::vec3 d = std::sqrt(std::max(1 - radius * radius, 0.0f)) * towards +
                        radius * (std::cos(turn) * right + std::sin(turn) * up);
    if (!(glm::dot(d, normal) > 0)) continue;
    free += cells.share(grid.around(glm::normalize(d))), ++seen;
  }
  return seen > 0 ? free / float(seen) : 1.0f;
}

bool hardly_moved(const NearLight& a, const NearLight& b) {
  constexpr float kMost = NearShares::kKeptAngle, kNearness = 0.003f, kSize = 0.01f;
  const glm::vec3 turn = a.direction - b.direction;
  return glm::dot(turn, turn) <= kMost * kMost &&
         std::fabs(a.inverse_distance - b.inverse_distance) <= kNearness * a.inverse_distance &&
         std::fabs(a.sin_radius - b.sin_radius) <= kSize * a.sin_radius;
}

}  // namespace

std::vector<glm::vec3> NearShares::update(const Scene& scene, const Lighting& lighting,
                                          SharesOf of) {
  const std::size_t count = scene.mesh.vertices.size();
  const NearLights& near_lights = lighting.near_lights;
  std::vector<glm::vec3> shares(count, glm::vec3(0));
  if (near_lights.empty()) return shares;
  const VertexVisibility* visibility =
      of == SharesOf::directions ? scene.directions.get() : nullptr;
  const Basis basis{scene.mesh.vertices.data(), visibility,         count,
                    scene.marker_from_object,   near_lights.centre, of};
  if (!(basis == basis_)) basis_ = basis, kept_.clear();
  const glm::mat3 turn(scene.marker_from_object.rotation), back = glm::transpose(turn);
  const glm::vec3 shift(scene.marker_from_object.translation);
  std::vector<glm::vec3> normals(count), all(count);
  for (std::size_t i = 0; i < count; ++i) normals[i] = turn * scene.normals[i];
  evaluate(lighting.irradiance, normals, all);

  std::vector<Kept> now;
  std::vector<std::size_t> moved;  // of those
  for (const NearLight& light : near_lights.lights) {
    const auto same = std::find_if(kept_.begin(), kept_.end(), [&](const Kept& k) {
      return !k.changes.empty() && hardly_moved(k.light, light);
    });
    if (same == kept_.end()) moved.push_back(now.size());
    now.push_back(same == kept_.end() ? Kept{light, std::vector<float>(count)} : std::move(*same));
  }
  kept_ = std::move(now);

  const OctahedralGrid* grid = visibility ? &octahedral_grid(visibility->size) : nullptr;
  parallel_for(int(count), kGrain, [&](int begin, int end) {
    for (const std::size_t k : moved) {
      Kept& kept = kept_[k];
      const NearLight& light = kept.light;
      for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
        const auto seen = [&](glm::vec3 arrow) {
          const float all_of_it = shared::near_irradiance(arrow, light.sin_radius, normals[i]);
          const float length = glm::length(arrow);
          if (!visibility || !(all_of_it > 0) || !(length > 1e-6f)) return all_of_it;
          return all_of_it * free_part(FreeCells(*visibility, i), *grid, scene.normals[i],
                                       back * (arrow / length),
                                       std::min(light.sin_radius / length, 1.0f));
        };
        const glm::vec3 offset = turn * scene.mesh.vertices[i] + shift - near_lights.centre;
        kept.changes[i] =
            seen(shared::near_arrow(light.direction, light.inverse_distance, offset)) -
            seen(light.direction);
      }
    }
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      glm::vec3 change(0);
      for (std::size_t k = 0; k < kept_.size(); ++k)
        change += kept_[k].changes[i] * near_lights.lights[k].irradiance;
      if (of == SharesOf::visibility) change *= scene.visibility[i];
      for (int c = 0; c < 3; ++c)
        shares[i][c] = all[i][c] > 0 ? std::clamp(change[c] / all[i][c], -1.0f, kMostShare) : 0.0f;
    }
  });
  return shares;
}

}  // namespace fastibl
