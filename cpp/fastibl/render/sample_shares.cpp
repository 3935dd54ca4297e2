#include "fastibl/render/sample_shares.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "fastibl/core/parallel.h"
#include "fastibl/shading/glossy_shares.h"
#include "fastibl/shading/lobe_cells.h"
#include "fastibl/shading/near_lobes.h"
#include "fastibl/shading/near_tracer.h"
#include "fastibl/shading/shade.h"
#include "fastibl/shading/traced_lights.h"
#include "fastibl/shading/traced_shares.h"

namespace fastibl {

std::vector<glm::vec3> sample_colours(const SceneSamples& samples, std::size_t count,
                                      const Material& material, const Lighting& lighting,
                                      glm::vec4 share) {
  std::vector<Fragment> fragments;
  for (const SceneSamples::Surface& s : std::span(samples.surface).first(count)) {
    Fragment& f = fragments.emplace_back();
    f.coverage = 1, f.position = s.position, f.normal = s.normal, f.share = share;
    f.tangent = s.tangent, f.uv = s.uv, f.color = s.color;
    f.uv_dx = {0.02f, 0}, f.uv_dy = {0, 0.02f};  // about a pixel's part of a texture
  }
  std::vector<glm::vec3> result(count);
  const SurfaceShading shading(material, lighting);
  // The samples of one eye at a time.
  for (std::size_t first = 0, last; first < count; first = last) {
    const int view = samples.surface[first].view;
    for (last = first; last < count && samples.surface[last].view == view;) ++last;
    shading(std::span(fragments).subspan(first, last - first), samples.eyes[std::size_t(view)],
            std::span(result).subspan(first, last - first));
  }
  return result;
}

SampleShares::SampleShares(const SceneSamples& samples, const Scene& scene, const Lighting& light)
    : samples_(samples), light_(light) {
  scene_.mesh.vertices = samples.vertices;
  scene_.normals = samples.normals;
  scene_.visibility = samples.openness;
  scene_.directions = {std::shared_ptr<const void>(), &samples.visibility};
  scene_.bvh = scene.bvh;
  scene_.material = scene.material;
  scene_.marker_from_object.rotation = glm::dmat3(samples.turned);
  scene_.marker_from_object.translation = {0, 0, samples.lifted};
}

std::vector<glm::vec4> SampleShares::of(SelfShadowMethod method) {
  if (method == SelfShadowMethod::none)
    return of_vertices(Shares(samples_.vertices.size(), glm::vec4(1)), SharesOf::all);
  if (method == SelfShadowMethod::ambient) {
    Shares open;
    for (const float v : samples_.openness) open.emplace_back(glm::vec3(v), 1);
    return of_vertices(std::move(open), SharesOf::visibility);
  }
  if (transfer_.empty()) transfer_ = transfer();
  Shares shares = transfer_;
  if (samples_.visibility.blocks_nothing()) return shares;
  if (method == SelfShadowMethod::traced_lights) rays_ = by_rays_to_lights(shares, true);
  if (method == SelfShadowMethod::traced) by_rays(shares);
  // With near lights, lobes are the vertices' own.
  if (method == SelfShadowMethod::pixel_transfer && light_.near_lights.empty()) by_pixel(shares);
  return shares;
}

// Adds the shares of the samples of one view, from those of the vertices.
void SampleShares::add_between(std::span<const glm::vec4> by_vertex, std::size_t view,
                               Shares& shares) const {
  for (std::size_t i = 0; i < samples_.seen; ++i) {
    const SceneSamples::Surface& s = samples_.surface[i];
    if (s.view != int(view)) continue;
    for (int k = 0; k < 3; ++k) shares[i] += s.weights[k] * by_vertex[std::size_t(s.corners[k])];
  }
}

std::vector<glm::vec4> SampleShares::of_vertices(Shares by_vertex, SharesOf of) const {
  if (!light_.near_lights.empty()) add_shares(NearShares().update(scene_, light_, of), by_vertex);
  Shares result(samples_.seen, glm::vec4(0));
  for (std::size_t v = 0; v < samples_.picture_count; ++v) add_between(by_vertex, v, result);
  return result;
}

// By the directions that are free.
std::vector<glm::vec4> SampleShares::transfer() {
  const CubeMap& map = *light_.radiance;
  const Material& material = scene_.material;
  own_.assign(samples_.vertices.size(), glm::vec4(1));
  if (!light_.near_lights.empty())
    near_changes_ = near_.update(scene_, light_, SharesOf::directions);
  const bool blocks = !samples_.visibility.blocks_nothing();
  if (blocks) cells_.update(map, glm::transpose(samples_.turned), samples_.visibility.size);
  if (blocks && material.reads_irradiance())
    diffuse_shares(samples_.visibility, cells_, light_.irradiance, samples_.normals,
                   samples_.turned, own_);
  const std::optional<LobeShape> lobe = blocks ? material.lobe() : std::nullopt;
  std::optional<NearLobes> near_lobes;
  if (lobe && !near_changes_.empty())
    near_lobes.emplace(scene_, near_, cells_, glm::vec3(map.level_at_most(16).mean()), *lobe);
  Shares result(samples_.seen, glm::vec4(0));
  for (std::size_t v = 0; v < samples_.picture_count; ++v) {
    const glm::vec3 lifted(0, 0, samples_.lifted);
    Shares by_vertex = own_;
    if (lobe)
      glossy_shares(samples_.visibility, cells_, *lobe, samples_.vertices, samples_.normals,
                    in_mesh(samples_.eyes[v] - lifted), by_vertex,
                    near_lobes ? &*near_lobes : nullptr);
    if (!near_changes_.empty()) add_shares(near_changes_, by_vertex);
    add_between(by_vertex, v, result);
  }
  return result;
}

// Sets those of glossy light: by each sample's lobe, and by what is hidden from the corners around
// it.
void SampleShares::by_pixel(Shares& shares) const {
  const std::optional<LobeShape> lobe = scene_.material.lobe();
  if (!lobe) return;
  const LobeCells cells(cells_, *lobe);
  std::array<HiddenCells, 3> hidden{HiddenCells(cells.size()), HiddenCells(cells.size()),
                                    HiddenCells(cells.size())};
  for (std::size_t i = 0; i < shares.size(); ++i) {
    if (!is_touched(shares[i].w)) continue;
    const SceneSamples::Surface& s = samples_.surface[i];
    for (std::size_t k = 0; k < 3; ++k)
      hidden[k].set(samples_.visibility.edges_of(std::size_t(s.corners[k])),
                    samples_.visibility.size);
    shares[i].w =
        cells.share(in_mesh(s.normal), in_mesh(s.to_eye),
                    {{hidden[0].masks(), hidden[1].masks(), hidden[2].masks()}, s.weights});
  }
}

FragmentPlace SampleShares::place_of(const SceneSamples::Surface& s) const {
  FragmentPlace at{{}, {{}, s.weights, {}, in_mesh(s.normal)}};
  for (std::size_t k = 0; k < 3; ++k) {
    at.entries[k] = std::size_t(s.corners[k]);
    at.place.corners[k].normal = samples_.normals[at.entries[k]];
  }
  return at;
}

EntryShares SampleShares::of_entries(Shares& all) const {
  all = own_;
  if (!near_changes_.empty()) add_shares(near_changes_, all);
  return {own_, all};
}

// By rays to the brightest light, and by each sample's lobe: see TracedLights.
LightRays SampleShares::by_rays_to_lights(Shares& shares, bool diffuse) const {
  if (!scene_.bvh) return {};
  const VertexVisibility& visibility = samples_.visibility;
  const BrightCells cells(*light_.radiance, cells_, glm::transpose(samples_.turned), glm::mat3(1));
  std::optional<NearTracer> to_near;
  if (!near_changes_.empty()) to_near.emplace(scene_, near_);
  const LightTracer tracer(*scene_.bvh, cells, cells_, light_.irradiance, scene_.material,
                           samples_.turned, to_near ? &*to_near : nullptr, diffuse);
  Shares all;
  const EntryShares entry_shares = of_entries(all);
  std::vector<LightTracer::Count> rays(shares.size());
  parallel_for(int(shares.size()), 16, [&](int begin, int end) {
    HiddenCells hidden_all(visibility.size);
    const int lobe_size = tracer.mask_size().value_or(visibility.size);
    std::array hidden{HiddenCells(lobe_size), HiddenCells(lobe_size), HiddenCells(lobe_size)};
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      const SceneSamples::Surface& s = samples_.surface[i];
      const FragmentPlace at = place_of(s);
      BrightCells::Corners corners;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::span<const std::uint16_t> edges = visibility.edges_of(at.entries[k]);
        hidden_all.set(edges, visibility.size), hidden[k].set(edges, visibility.size);
        const glm::vec3 normal = at.place.corners[k].normal;
        corners[k] = {cells.states(hidden_all.masks(), normal), normal};
      }
      const LightTracer::Asked asked =
          tracer.unsure(corners[0].states, corners[1].states, corners[2].states, at.entries);
      if (!tracer.changes(shares[i], asked)) continue;
      // As many rays as from a pixel's samples, so that they are counted as there.
      const glm::vec3 from = start(s);
      const std::array starts{from, from, from, from};
      static_assert(starts.size() == BrightCells::kStarts);
      rays[i] = tracer.trace(
          shares[i],
          {starts, at.place.normal, in_mesh(s.to_eye), entry_shares.of_others(at), at.entries,
           entry_shares.of_map_at(at.entries)},
          corners, {{hidden[0].masks(), hidden[1].masks(), hidden[2].masks()}, s.weights}, asked);
    }
  });
  const double count = double(std::max<std::size_t>(rays.size(), 1));
  LightRays mean{0, 0};
  for (const LightTracer::Count& r : rays) mean.traced += r.traced, mean.summed += r.summed;
  return {mean.traced / count, mean.summed / count};
}

// Traces all shares: see trace_shares().
void SampleShares::by_rays(Shares& shares) const {
  const bool diffuse = scene_.material.reads_irradiance();
  const std::optional<LobeShape> lobe = scene_.material.lobe();
  const bool near_light = !near_changes_.empty();
  if (near_light && !scene_.bvh) return;
  const TracedLight light(*samples_.bvh, *light_.radiance, glm::mat3(1), diffuse,
                          near_light ? std::nullopt : lobe);
  std::optional<NearTracer> to_near;
  if (near_light) to_near.emplace(scene_, near_);
  Shares all;
  const EntryShares entry_shares = of_entries(all);
  parallel_for(int(shares.size()), 16, [&](int begin, int end) {
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      const SceneSamples::Surface& s = samples_.surface[i];
      const glm::vec4 traced = light.shares(s.start, s.normal, s.to_eye);
      if (!near_light) {
        shares[i] = traced;
        continue;
      }
      if (!diffuse) continue;
      const FragmentPlace at = place_of(s);
      const glm::vec3 share = glm::vec3(traced) + entry_shares.of_others(at) +
                              traced_near_change(*to_near, light_.irradiance, samples_.turned, at,
                                                 start(s), entry_shares.of_map_at(at.entries));
      shares[i] = glm::vec4(glm::max(share, glm::vec3(0)), shares[i].w);
    }
  });
  // All light by rays does not know where glossy light is; the brightest does.
  if (near_light && lobe) by_rays_to_lights(shares, false);
}

}  // namespace fastibl
