#include "fastibl/shading/glossy_shares.h"

#include <cmath>
#include <optional>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/shading/triangle_place.h"

namespace fastibl {
namespace {

constexpr int kGrain = 64;         // vertices
constexpr float kBehind = -0.25f;  // n · v of vertices between which no pixel is seen

}  // namespace

void glossy_shares(const VertexVisibility& visibility, const CellLight& light,
                   const LobeShape& lobe, std::span<const glm::vec3> vertices,
                   std::span<const glm::vec3> normals, glm::vec3 eye, std::span<glm::vec4> shares,
                   const NearLobes* near_lobes) {
  check(visibility.size == light.size(), "light must have the cells of the visibility, ",
        visibility.size, ", got ", light.size());
  check(visibility.vertex_count() == vertices.size() && vertices.size() == normals.size() &&
            shares.size() == visibility.entries(),
        "there must be as many vertices and normals, ", visibility.vertex_count(),
        ", and as many shares as entries, ", visibility.entries(), ", got ", vertices.size(), ", ",
        normals.size(), " and ", shares.size());
  const LobeCells cells(near_lobes ? near_lobes->flux() : std::span<const float>(light.flux()),
                        lobe);
  parallel_for(int(shares.size()), kGrain, [&](int begin, int end) {
    HiddenCells hidden(cells.size());
    for (int i = begin; i < end; ++i) {
      const std::size_t e = std::size_t(i), v = e % vertices.size();
      shares[e].w = 1;
      const std::span<const std::uint16_t> edges = visibility.edges_of(e);
      const glm::vec3 n = e == v ? normals[v] : -normals[v], to = eye - vertices[v];
      const float length = glm::length(to);
      if (edges.empty() || !(length > 0) || !std::isfinite(length)) continue;
      const glm::vec3 view = to / length;
      if (glm::dot(n, view) < kBehind) {
        shares[e].w = kMostTouched;
        continue;
      }
      hidden.set(edges, visibility.size);
      if (!near_lobes) {
        shares[e].w = cells.share(n, view, hidden.masks());
        continue;
      }
      LobeCells::Sums sums = cells.sums(n, view, hidden.masks());
      near_lobes->add(e, vertices[v], n, view, sums);
      if (sums.lost > 0) shares[e].w = sums.share();
    }
  });
}

void GlossyPixelShares::operator()(const Scene& scene, const CellLight& light, glm::vec3 eye,
                                   std::span<FragmentBand> bands) {
  const std::optional<LobeShape> lobe = scene.material.lobe();
  if (!lobe || !scene.directions || light.size() != scene.directions->size) return;
  const LobeCells cells(light, *lobe);
  masks_.keep(scene.directions, cells.size());
  const FragmentPlaces places(scene);
  parallel_for(int(bands.size()), 4, [&](int begin, int end) {
    for (int i = begin; i < end; ++i)
      for (Fragment& f : bands[std::size_t(i)].object) {
        if (!is_touched(f.share.w)) continue;
        const FragmentPlace at = places.of(f);
        const auto masks = [&](int k) { return masks_.of(at.entries[std::size_t(k)]); };
        f.share.w = cells.share(at.place.normal, places.view(f, eye),
                                {{masks(0), masks(1), masks(2)}, at.place.weights});
      }
  });
}

}  // namespace fastibl
