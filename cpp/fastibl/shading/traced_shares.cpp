#include "fastibl/shading/traced_shares.h"

#include <algorithm>
#include <array>
#include <unordered_map>
#include <vector>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/scene/sampled_lobe.h"
#include "fastibl/shading/bake_visibility.h"
#include "fastibl/shading/hidden_cells.h"
#include "fastibl/shading/light_sums.h"
#include "fastibl/shading/lobe_cells.h"

namespace fastibl {
namespace {

// States of the pieces from corners of triangles, by the four cells around each piece.
class CornerPieces {
 public:
  CornerPieces(const Scene& scene, const LightPieces& pieces)
      : scene_(scene), pieces_(pieces), hidden_(scene.directions->size) {
    const OctahedralGrid& grid = octahedral_grid(scene.directions->size);
    const LitDirections& lit = pieces.directions();
    for (std::size_t i = 0; i < pieces.count(); ++i) {
      const OctahedralGrid::Corners at = grid.around({lit.x[i], lit.y[i], lit.z[i]});
      cells_.push_back({at.cells[0], at.cells[1], at.cells[2], at.cells[3]});
    }
  }

  // What all corners agree on. Valid until the next call.
  std::span<const PieceState> of(const std::array<std::size_t, 3>& entries,
                                 const TrianglePlace& place) {
    if (entries == last_) return merged_;
    last_ = entries;
    if (known_.size() > kMostKept) known_.clear();
    merged_ = corner(entries[0], place.corners[0].normal);
    for (std::size_t k = 1; k < 3; ++k) {
      const std::vector<PieceState>& other = corner(entries[k], place.corners[k].normal);
      for (std::size_t i = 0; i < merged_.size(); ++i)
        if (merged_[i] != other[i]) merged_[i] = PieceState::unknown;
    }
    return merged_;
  }

 private:
  static constexpr std::size_t kMostKept = 2000;

  const std::vector<PieceState>& corner(std::size_t entry, glm::vec3 normal) {
    // Cells tell only what is above a corner's tangent plane; another corner's is some way off.
    constexpr float kNearHorizon = 0.15f;
    std::vector<PieceState>& states = known_[entry];
    if (!states.empty()) return states;
    const LitDirections& lit = pieces_.directions();
    hidden_.set(scene_.directions->edges_of(entry), scene_.directions->size);
    states.assign(cells_.size(), PieceState::unknown);
    for (std::size_t i = 0; i < states.size(); ++i) {
      if (lit.x[i] * normal.x + lit.y[i] * normal.y + lit.z[i] * normal.z < kNearHorizon) continue;
      const std::array<int, 4>& c = cells_[i];
      const int count = hidden_[c[0]] + hidden_[c[1]] + hidden_[c[2]] + hidden_[c[3]];
      if (count == 0) states[i] = PieceState::free;
      if (count == 4) states[i] = PieceState::hidden;
    }
    return states;
  }

  const Scene& scene_;
  const LightPieces& pieces_;
  HiddenCells hidden_;
  std::vector<std::array<int, 4>> cells_;
  std::unordered_map<std::size_t, std::vector<PieceState>> known_;
  std::array<std::size_t, 3> last_ = {~std::size_t{0}, 0, 0};
  std::vector<PieceState> merged_;
};

}  // namespace

TracedLight::TracedLight(const Bvh& bvh, const CubeMap& map, const glm::mat3& map_from_bvh,
                         bool diffuse, const std::optional<LobeShape>& lobe)
    : bvh_(bvh),
      map_(map),
      map_from_bvh_(map_from_bvh),
      diffuse_(diffuse),
      lobe_(lobe),
      height_(lobe, 1e6f),
      pieces_(map, glm::transpose(map_from_bvh), kPieces) {}

glm::vec4 TracedLight::shares(glm::vec3 start, glm::vec3 normal, glm::vec3 view,
                              std::span<const PieceState> known) const {
  constexpr float kGrazing = 0.02f, kTapsWorth = 3;
  const float cosine = glm::dot(normal, view);
  if (cosine < kGrazing) view = glm::normalize(view + (kGrazing - cosine) * normal);
  const LitDirections& lit = pieces_.directions();
  thread_local std::vector<std::uint8_t> free, hidden;
  thread_local std::vector<std::size_t> asked;
  free.assign(lit.count, 0);
  glm::vec4 result(1);
  std::span<const LobeTap> taps;
  bool by_taps = false;
  LightSums sums;
  if (lobe_) {
    taps = lobe_taps(map_, map_from_bvh_ * normal, map_from_bvh_ * view, *lobe_, kRays);
    float sum = 0, squares = 0;
    for (const LobeTap& tap : taps) {
      const float part = tap.weight * (tap.radiance.x + tap.radiance.y + tap.radiance.z);
      sum += part, squares += part * part;
    }
    sum_light(lit, free.data(), normal, view, height_, sums);
    const float whole = sums.open_lobe[0] + sums.open_lobe[1] + sums.open_lobe[2];
    // Equally weighted, there would be (Σ w)² / Σ w² of them; taps lie better than pieces.
    by_taps = kTapsWorth * sum * sum * sums.open_squares >= whole * whole * squares;
    if (by_taps) result.w = along_taps(taps, start);
  }
  if (!diffuse_ && (!lobe_ || by_taps)) return result;
  asked.clear();
  for (std::size_t i = 0; i < pieces_.count(); ++i) {
    if (!known.empty() && known[i] != PieceState::unknown)
      free[i] = known[i] == PieceState::free;
    else if (lit.x[i] * normal.x + lit.y[i] * normal.y + lit.z[i] * normal.z > 0)
      asked.push_back(i);
  }
  if (!asked.empty()) {
    DirectionSet set(int(asked.size()));
    for (std::size_t i = 0; i < asked.size(); ++i)
      set.set(int(i), {lit.x[asked[i]], lit.y[asked[i]], lit.z[asked[i]]});
    hidden.assign(asked.size(), 0);
    bvh_.occluded(start, set, 0, hidden);
    for (std::size_t i = 0; i < asked.size(); ++i) free[asked[i]] = !hidden[i];
  }
  sum_light(lit, free.data(), normal, view, height_, sums);
  const auto share = [](float part, float all) {
    return all > 0 ? std::clamp(part / all, 0.0f, 1.0f) : 1.0f;
  };
  if (diffuse_)
    for (int c = 0; c < 3; ++c) result[c] = share(sums.irradiance[c], sums.open_irradiance[c]);
  if (lobe_ && !by_taps)
    result.w = share(sums.lobe[0] + sums.lobe[1] + sums.lobe[2],
                     sums.open_lobe[0] + sums.open_lobe[1] + sums.open_lobe[2]);
  return result;
}

float TracedLight::along_taps(std::span<const LobeTap> taps, glm::vec3 start) const {
  const glm::mat3 bvh_from_map = glm::transpose(map_from_bvh_);
  thread_local DirectionSet directions(kRays);
  thread_local std::vector<std::uint8_t> hidden;
  directions.count = int(taps.size());
  for (std::size_t i = 0; i < taps.size(); ++i)
    directions.set(int(i), bvh_from_map * taps[i].direction);
  hidden.resize(taps.size());
  bvh_.occluded(start, directions, 0, hidden);
  float all = 0, free = 0;
  for (std::size_t i = 0; i < taps.size(); ++i) {
    const glm::vec3& light = taps[i].radiance;
    const float part = taps[i].weight * (light.x + light.y + light.z);
    all += part;
    if (!hidden[i]) free += part;
  }
  return all > 0 ? std::clamp(free / all, 0.0f, 1.0f) : 1.0f;
}

glm::vec3 traced_near_change(const NearTracer& near_tracer, const Irradiance& irradiance,
                             const glm::mat3& map_from_bvh, const FragmentPlace& at,
                             glm::vec3 start, const std::array<glm::vec3, 3>& own) {
  std::array<glm::vec3, 4> normals, all;
  for (std::size_t k = 0; k < 3; ++k) normals[k] = map_from_bvh * at.place.corners[k].normal;
  normals[3] = map_from_bvh * at.place.normal;
  evaluate(irradiance, normals, all);
  const NearTracer::Place place{at.place.normal,  {&start, 1}, at.entries,
                                at.place.weights, all,         own};
  int rays = 0;
  std::array<float, NearTracer::kMost> open{}, lost{};
  for (std::size_t k = 0; k < near_tracer.lights().size(); ++k) {
    const NearTracer::Light& l = near_tracer.lights()[k];
    open[k] = near_tracer.open(l, place, rays);
    lost[k] = 1 - near_tracer.open_in_map(l, place, rays);
  }
  return near_tracer.change(place, ~std::uint32_t{0}, open, lost);
}

void trace_shares(const Scene& scene, const Lighting& lighting, glm::vec3 eye,
                  const EntryShares& shares, const NearShares* near_shares,
                  std::span<FragmentBand> bands) {
  if (!scene.bvh || !scene.directions || shares.own.size() != scene.directions->entries()) return;
  const bool diffuse = scene.material.reads_irradiance();
  std::optional<LobeShape> lobe;
  if (!near_shares) lobe = scene.material.lobe();
  if (!diffuse && !lobe) return;
  const glm::mat3 map_from_mesh(scene.marker_from_object.rotation);
  const float offset = ray_offset(scene.mesh);
  const TracedLight light(*scene.bvh, *lighting.radiance, map_from_mesh, diffuse, lobe);
  const FragmentPlaces places(scene);
  std::optional<NearTracer> to_near;
  if (near_shares) to_near.emplace(scene, *near_shares);
  parallel_for(int(bands.size()), 4, [&](int begin, int end) {
    CornerPieces corner_pieces(scene, light.pieces());
    for (int i = begin; i < end; ++i)
      for (Fragment& f : bands[std::size_t(i)].object) {
        if (!(diffuse || is_touched(f.share.w))) continue;
        const FragmentPlace at = places.of(f);
        const auto& [entries, place] = at;
        const bool touched = std::ranges::any_of(
            entries, [&](std::size_t e) { return !scene.directions->edges_of(e).empty(); });
        if (!touched) continue;
        const glm::vec3 start = ray_start(place, offset);
        const glm::vec4 traced = light.shares(
            start, place.normal, places.view(f, eye),
            scene.corners_tell ? corner_pieces.of(entries, place) : std::span<const PieceState>{});
        if (diffuse) {
          // Where a fragment stands for several triangles, its share is their mean.
          const glm::vec3 others = shares.of_others(at);
          const glm::vec3 own = glm::vec3(f.share) - others + glm::vec3(traced) - shares.of_map(at);
          glm::vec3 share = glm::clamp(own, glm::vec3(0), glm::vec3(1)) + others;
          if (to_near)
            share += traced_near_change(*to_near, lighting.irradiance, map_from_mesh, at, start,
                                        shares.of_map_at(entries));
          f.share = glm::vec4(glm::max(share, glm::vec3(0)), f.share.w);
        }
        if (lobe && is_touched(f.share.w)) f.share.w = traced.w;
      }
  });
}

}  // namespace fastibl
