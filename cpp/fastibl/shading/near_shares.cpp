#include "fastibl/shading/near_shares.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <optional>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/scene/shared_formulas.h"
#include "fastibl/shading/hidden_cells.h"
#include "fastibl/shading/light_disc.h"

namespace fastibl {
namespace {

constexpr int kGrain = 256;           // vertices
constexpr float kLeastTurn = 0.002f;  // radians
// Points of a light's disc where the object is looked for: the most, and the cells for each.
constexpr int kMostPoints = 16;
constexpr float kPointArea = 2;

// The free share between the middles of four cells.
float free_share(const HiddenCells& hidden, const OctahedralGrid::Corners& corners) {
  float free = 0;
  for (int k = 0; k < 4; ++k) free += hidden[corners.cells[k]] ? 0 : corners.shares[k];
  return free;
}

// Points of a light's disc, in the frame of the object, and the cells around them.
struct Disc {
  int count = 0;
  float x[kMostPoints], y[kMostPoints], z[kMostPoints];
  OctahedralGrid::Corners corners[kMostPoints];

  // towards: unit.
  Disc(const OctahedralGrid& grid, glm::vec3 towards, float sin_radius) {
    const float cell = std::sqrt(4 * kPi) / float(grid.size());
    const float across = 2 * std::asin(std::min(sin_radius, 1.0f)) / cell;
    count = std::clamp(int(std::ceil(across * across / kPointArea)), 1, kMostPoints);
    if (count == 1) {
      x[0] = towards.x, y[0] = towards.y, z[0] = towards.z;
      corners[0] = grid.around(towards);
      return;
    }
    const DiscPoints<kMostPoints> points(towards, sin_radius, count);
    std::copy_n(points.x, kMostPoints, x);
    std::copy_n(points.y, kMostPoints, y);
    std::copy_n(points.z, kMostPoints, z);
    float u[kMostPoints], v[kMostPoints];
    octahedral_points(kMostPoints, x, y, z, u, v);
    for (int i = 0; i < count; ++i) corners[i] = grid.corners({u[i], v[i]});
  }
};

// Free part of a light's disc, among what lies above the tangent plane.
float free_part(const HiddenCells& hidden, const Disc& disc, glm::vec3 normal) {
  if (disc.count == 1) return free_share(hidden, disc.corners[0]);
  float free = 0;
  int seen = 0;
  for (int i = 0; i < disc.count; ++i) {
    if (!(disc.x[i] * normal.x + disc.y[i] * normal.y + disc.z[i] * normal.z > 0)) continue;
    free += free_share(hidden, disc.corners[i]), ++seen;
  }
  return seen > 0 ? free / float(seen) : 1.0f;
}

// What all of the disc and of the cells around it have in common. towards: the light, unit.
NearState state_of(const HiddenCells& hidden, const OctahedralGrid& grid, glm::vec3 towards,
                   float sin_radius, glm::vec3 normal) {
  constexpr float kLow = 0.05f, kGrazing = 0.1f;  // cosines, as in bright_cells.cpp
  const float cosine = glm::dot(towards, normal);
  if (cosine < -sin_radius - kLow) return NearState::low;
  if (cosine < kGrazing) return NearState::mixed;
  const float cell = std::sqrt(4 * kPi) / float(grid.size());
  const float free =
      free_part(hidden, Disc(grid, towards, std::min(sin_radius + cell, 1.0f)), normal);
  constexpr float kAll = 1 - 1e-5f;
  return free >= kAll ? NearState::open : free <= 1 - kAll ? NearState::hidden : NearState::mixed;
}

std::uint64_t next_version() {
  static std::atomic<std::uint64_t> last = 0;
  return ++last;
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
  // Surfaces that are seen from behind count with both sides.
  const std::size_t vertices = scene.mesh.vertices.size(),
                    count = vertices * std::size_t(scene.sides());
  const NearLights& near_lights = lighting.near_lights;
  std::vector<glm::vec3> shares(count, glm::vec3(0));
  if (near_lights.empty()) {
    lights_.clear(), version_ = next_version();
    return shares;
  }
  const VertexVisibility* visibility =
      of == SharesOf::directions ? scene.directions.get() : nullptr;
  const Basis basis{scene.mesh.vertices.data(), visibility,         count,
                    scene.marker_from_object,   near_lights.centre, of};
  if (!(basis == basis_)) basis_ = basis, lights_.clear(), version_ = next_version();
  const glm::mat3 turn(scene.marker_from_object.rotation), back = glm::transpose(turn);
  const glm::vec3 shift(scene.marker_from_object.translation);
  std::vector<glm::vec3> normals(count), all(count);
  for (std::size_t i = 0; i < count; ++i)
    normals[i] = i < vertices ? turn * scene.normals[i] : -normals[i - vertices];
  // What nothing reads was not fitted; lobes ask for what is hidden alone.
  if (scene.material.reads_irradiance()) evaluate(lighting.irradiance, normals, all);

  // Whether any place of the object sees a light elsewhere than the map's centre does.
  const auto turns = [&](const NearLight& l) {
    return std::ranges::any_of(scene.mesh.vertices, [&](const glm::vec3& v) {
      return l.inverse_distance * glm::length(turn * v + shift - near_lights.centre) > kLeastTurn;
    });
  };

  std::vector<OfLight> now;
  std::vector<std::size_t> moved;  // of those
  for (const NearLight& light : near_lights.lights) {
    const auto same = std::find_if(lights_.begin(), lights_.end(), [&](const OfLight& k) {
      return !k.changes.empty() && hardly_moved(k.light, light);
    });
    if (std::size_t(same - lights_.begin()) != now.size()) version_ = next_version();
    if (same == lights_.end()) {
      moved.push_back(now.size());
      const std::size_t known = visibility && turns(light) ? count : 0;
      now.push_back({light, std::vector<float>(count),
                     std::vector<NearState>(known, NearState::open),
                     std::vector<float>(known, 1.0f)});
    } else {
      now.push_back(std::move(*same));
      now.back().light.irradiance = light.irradiance;
    }
  }
  if (!moved.empty() || now.size() != lights_.size()) version_ = next_version();
  lights_ = std::move(now);

  const OctahedralGrid* grid = visibility ? &octahedral_grid(visibility->size) : nullptr;
  // The disc of each light that moved, as the map's centre sees it.
  std::vector<Disc> discs;
  if (grid)
    for (const std::size_t k : moved)
      discs.emplace_back(*grid, back * lights_[k].light.direction,
                         std::min(lights_[k].light.sin_radius, 1.0f));
  parallel_for(int(count), kGrain, [&](int begin, int end) {
    std::optional<HiddenCells> hidden;
    if (grid && !moved.empty()) hidden.emplace(grid->size());
    for (std::size_t i = std::size_t(begin); i < std::size_t(end) && !moved.empty(); ++i) {
      const std::span<const std::uint16_t> edges =
          hidden ? visibility->edges_of(i) : std::span<const std::uint16_t>();
      if (!edges.empty()) hidden->set(edges, visibility->size);
      const glm::vec3 offset =
          turn * scene.mesh.vertices[i % vertices] + shift - near_lights.centre;
      const glm::vec3 normal = back * normals[i];
      for (std::size_t m = 0; m < moved.size(); ++m) {
        OfLight& of_light = lights_[moved[m]];
        const NearLight& light = of_light.light;
        const glm::vec3 arrow = shared::near_arrow(light.direction, light.inverse_distance, offset);
        float here = shared::near_irradiance(arrow, light.sin_radius, normals[i]);
        float centre = shared::near_irradiance(light.direction, light.sin_radius, normals[i]);
        if (!edges.empty()) {
          const float length = glm::length(arrow);
          if (length > 1e-6f) {
            const glm::vec3 towards = back * (arrow / length);
            const float sin_radius = std::min(light.sin_radius / length, 1.0f);
            const float open =
                here > 0 ? free_part(*hidden, Disc(*grid, towards, sin_radius), normal) : 1.0f;
            here *= open;
            if (!of_light.states.empty()) {
              of_light.open[i] = open;
              of_light.states[i] = state_of(*hidden, *grid, towards, sin_radius, normal);
            }
          }
          if (centre > 0) centre *= free_part(*hidden, discs[m], normal);
        }
        of_light.changes[i] = here - centre;
      }
    }
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      glm::vec3 change(0);
      for (const OfLight& l : lights_) change += l.changes[i] * l.light.irradiance;
      if (of == SharesOf::visibility) change *= scene.visibility[i % vertices];
      for (int c = 0; c < 3; ++c)
        shares[i][c] = all[i][c] > 0 ? std::clamp(change[c] / all[i][c], -1.0f, kMostShare) : 0.0f;
    }
  });
  return shares;
}

}  // namespace fastibl
