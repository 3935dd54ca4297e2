#include "fastibl/render/sample_shares.h"

#include <algorithm>
#include <array>
#include <optional>
#include <span>

#include "fastibl/core/parallel.h"
#include "fastibl/shading/glossy_shares.h"
#include "fastibl/shading/lobe_cells.h"
#include "fastibl/shading/self_shadow.h"
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

std::vector<glm::vec4> ambient_shares(const SceneSamples& samples) {
  std::vector<glm::vec4> result;
  for (const SceneSamples::Surface& s : std::span(samples.surface).first(samples.seen)) {
    float open = 0;
    for (int k = 0; k < 3; ++k) open += s.weights[k] * samples.openness[std::size_t(s.corners[k])];
    result.emplace_back(glm::vec3(open), 1);
  }
  return result;
}

std::vector<glm::vec4> transfer_shares(const SceneSamples& samples, const CubeMap& map,
                                       const Irradiance& irradiance, const Material& material) {
  std::vector<glm::vec4> result(samples.seen, glm::vec4(1));
  if (samples.visibility.blocks_nothing()) return result;
  std::vector<glm::vec4> by_vertex(samples.vertices.size(), glm::vec4(1));
  CellLight light;
  light.update(map, glm::transpose(samples.turned), samples.visibility.size);
  if (material.reads_irradiance())
    diffuse_shares(samples.visibility, light, irradiance, samples.normals, samples.turned,
                   by_vertex);
  const std::optional<LobeShape> lobe = material.lobe();
  for (std::size_t v = 0; v < samples.picture_count; ++v) {
    const glm::vec3 lifted(0, 0, samples.lifted);
    if (lobe)
      glossy_shares(samples.visibility, light, *lobe, samples.vertices, samples.normals,
                    glm::transpose(samples.turned) * (samples.eyes[v] - lifted), by_vertex);
    for (std::size_t i = 0; i < result.size(); ++i) {
      const SceneSamples::Surface& s = samples.surface[i];
      if (s.view != int(v)) continue;
      result[i] = glm::vec4(0);
      for (int k = 0; k < 3; ++k) result[i] += s.weights[k] * by_vertex[std::size_t(s.corners[k])];
    }
  }
  return result;
}

void share_by_pixel(const SceneSamples& samples, const CubeMap& map, const Material& material,
                    std::vector<glm::vec4>& shares) {
  const std::optional<LobeShape> lobe = material.lobe();
  if (!lobe || samples.visibility.blocks_nothing()) return;
  CellLight light;
  light.update(map, glm::transpose(samples.turned), samples.visibility.size);
  const LobeCells cells(light, *lobe);
  const glm::mat3 mesh_from_marker = glm::transpose(samples.turned);
  std::array<HiddenCells, 3> hidden{HiddenCells(cells.size()), HiddenCells(cells.size()),
                                    HiddenCells(cells.size())};
  for (std::size_t i = 0; i < shares.size(); ++i) {
    if (!is_touched(shares[i].w)) continue;
    const SceneSamples::Surface& s = samples.surface[i];
    for (std::size_t k = 0; k < 3; ++k)
      hidden[k].set(samples.visibility.edges_of(std::size_t(s.corners[k])),
                    samples.visibility.size);
    shares[i].w =
        cells.share(mesh_from_marker * s.normal, mesh_from_marker * s.to_eye,
                    {{hidden[0].masks(), hidden[1].masks(), hidden[2].masks()}, s.weights});
  }
}

LightRays trace_lights(const SceneSamples& samples, const CubeMap& map,
                       const Irradiance& irradiance, const Material& material,
                       std::vector<glm::vec4>& shares) {
  const VertexVisibility& visibility = samples.visibility;
  if (visibility.blocks_nothing()) return {};
  const glm::mat3 mesh_from_map = glm::transpose(samples.turned);
  CellLight light;
  light.update(map, mesh_from_map, visibility.size);
  const BrightCells cells(map, light, mesh_from_map, samples.turned);
  const LightTracer tracer(*samples.bvh, cells, light, irradiance, material, samples.turned);
  std::vector<LightTracer::Count> rays(shares.size());
  parallel_for(int(shares.size()), 16, [&](int begin, int end) {
    HiddenCells all(visibility.size);
    const int lobe_size = tracer.mask_size().value_or(visibility.size);
    std::array hidden{HiddenCells(lobe_size), HiddenCells(lobe_size), HiddenCells(lobe_size)};
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      const SceneSamples::Surface& s = samples.surface[i];
      BrightCells::Corners corners;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t corner = std::size_t(s.corners[k]);
        all.set(visibility.edges_of(corner), visibility.size);
        hidden[k].set(visibility.edges_of(corner), visibility.size);
        corners[k] = {cells.states(all.masks(), samples.normals[corner]), samples.normals[corner]};
      }
      const LightTracer::Asked asked =
          tracer.unsure(corners[0].states, corners[1].states, corners[2].states);
      if (!tracer.changes(shares[i], asked)) continue;
      // As many rays as from a pixel's samples, so that they are counted as there.
      const std::array starts{s.start, s.start, s.start, s.start};
      static_assert(starts.size() == BrightCells::kStarts);
      rays[i] = tracer.trace(
          shares[i], {starts, mesh_from_map * s.normal, mesh_from_map * s.to_eye, glm::vec3(0)},
          corners, {{hidden[0].masks(), hidden[1].masks(), hidden[2].masks()}, s.weights}, asked);
    }
  });
  const double count = double(std::max<std::size_t>(rays.size(), 1));
  LightRays mean;
  for (const LightTracer::Count& r : rays) mean.traced += r.traced, mean.summed += r.summed;
  return {mean.traced / count, mean.summed / count};
}

void trace_shares(const SceneSamples& samples, const CubeMap& map, const Material& material,
                  std::vector<glm::vec4>& shares) {
  if (samples.visibility.blocks_nothing()) return;
  const TracedLight light(*samples.bvh, map, glm::mat3(1), material.reads_irradiance(),
                          material.lobe());
  parallel_for(int(shares.size()), 16, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      const SceneSamples::Surface& s = samples.surface[std::size_t(i)];
      shares[std::size_t(i)] = light.shares(s.start, s.normal, s.to_eye);
    }
  });
}

}  // namespace fastibl
