#include "fastibl/shading/glossy_shares.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <vector>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/octahedral.h"
#include "fastibl/shading/hidden_cells.h"

namespace fastibl {
namespace {

// Cells of a group: one cell of a grid of a quarter of the size.
constexpr int kLanes = HiddenCells::kGroup;
constexpr int kGrain = 64;         // vertices
constexpr int kFinest = 64;        // cells along an edge
constexpr float kReach = 2.2f;     // of a Blinn lobe, standard deviations
constexpr float kBehind = -0.25f;  // n · v of vertices that no pixel is seen between
constexpr float kGrazing = 0.02f;

// Middles of the cells of one grid in the order of the curve, and of its groups of 16.
struct Cells {
  int groups = 0;
  std::vector<float> x, y, z, group_x, group_y, group_z;
  float radius = 0;  // of a group, radians, from its middle
};

Cells make_cells(int size) {
  const OctahedralGrid &grid = octahedral_grid(size), &coarse = octahedral_grid(size / 4);
  Cells cells;
  cells.groups = coarse.count();
  float least = 1;
  for (std::size_t k = 0; k < grid.directions().size(); ++k) {
    const glm::vec3 d = grid.directions()[k];
    cells.x.push_back(d.x), cells.y.push_back(d.y), cells.z.push_back(d.z);
    least = std::min(least, glm::dot(d, coarse.directions()[k / kLanes]));
  }
  for (const glm::vec3& d : coarse.directions())
    cells.group_x.push_back(d.x), cells.group_y.push_back(d.y), cells.group_z.push_back(d.z);
  cells.radius = std::acos(least);
  return cells;
}

const Cells& cells_of(int size) {
  static const Cells all[3] = {make_cells(16), make_cells(32), make_cells(64)};
  return all[size / 32];
}

// Flux of the cells of another grid than the light's own.
struct Flux {
  std::vector<float> cells, groups;
};

Flux flux_of(const CellLight& light, std::size_t count) {
  const std::vector<float>& own = light.flux();
  Flux flux{std::vector<float>(count, 0.0f), std::vector<float>(count / kLanes, 0.0f)};
  const std::size_t finer = std::max(count, own.size());
  const float part = float(own.size()) / float(finer);  // of an own cell
  for (std::size_t k = 0; k < finer; ++k)
    flux.cells[k * count / finer] += part * own[k * own.size() / finer];
  for (std::size_t k = 0; k < count; ++k) flux.groups[k / kLanes] += flux.cells[k];
  return flux;
}

// A lobe seen from one vertex.
struct View {
  float nx, ny, nz, vx, vy, vz, nv;
  float half_exponent;                // Blinn's; 0 for GGX
  float alpha2, flatness, view_mask;  // GGX's: α², 1 − α², √(α² + (1 − α²)(n·v)²)
};

// Weight of the lobe in 16 directions: cos θ (n·h)^s, or cos θ D(h)/masking.
FASTIBL_INLINE void weigh(const View& view, const float* x, const float* y, const float* z,
                          float* weight) {
  float cosine[kLanes], half2[kLanes];
  for (int k = 0; k < kLanes; ++k) {
    const float c = x[k] * view.nx + y[k] * view.ny + z[k] * view.nz;
    const float to_view = x[k] * view.vx + y[k] * view.vy + z[k] * view.vz;
    const float sum = c + view.nv;
    cosine[k] = c > 0 ? c : 0;
    const float length2 = 2 + 2 * to_view;
    half2[k] = sum * sum / (length2 > 1e-6f ? length2 : 1e-6f);
  }
  if (view.half_exponent > 0) {
    for (int k = 0; k < kLanes; ++k) {
      // (n·h)^s = exp(s/2 ln(1 − u)), five terms of the logarithm's series: 5 % short at u = 0.7.
      float u = 1 - half2[k];
      u = u > 0 ? u : 0;
      const float logarithm = u * (1 + u * (0.5f + u * (1 / 3.0f + u * (0.25f + u * 0.2f))));
      float power = -1.44269504f * view.half_exponent * logarithm;  // of two
      power = power > -80 ? power : -80;
      const int whole = int(power) - 1;
      const float f = power - float(whole);  // in (0, 1], 1 where power is 0
      const float mantissa =
          1 + f * (0.693147f + f * (0.240227f + f * (0.0558f + f * 0.0096f)));  // 1e-4 off
      weight[k] = cosine[k] * mantissa * std::bit_cast<float>(std::int32_t(whole + 127) << 23);
    }
  } else {
    for (int k = 0; k < kLanes; ++k) {
      const float d = half2[k] * (view.alpha2 - 1) + 1;
      const float mask = std::sqrt(view.alpha2 + view.flatness * cosine[k] * cosine[k]) * view.nv +
                         view.view_mask * cosine[k];
      weight[k] = cosine[k] / (d * d * (mask > 1e-6f ? mask : 1e-6f));
    }
  }
}

struct Sums {
  float all = 0, lost = 0;
};

// axis: the lobe's middle; groups whose product with it is above `least` are looked at cell by
// cell; `far`: the others as a whole. hidden: a mask for each group.
FASTIBL_CLONES void add_up(const Cells& cells, const Flux& flux, const View& view,
                           const float* axis, float least, const HiddenCells::Mask* hidden,
                           bool far, Sums* sums) {
  float all[kLanes] = {}, lost[kLanes] = {};
  float near[kLanes], weight[kLanes];
  int any = far;
  for (int g = 0; g < cells.groups; ++g) {
    const float product = cells.group_x[std::size_t(g)] * axis[0] +
                          cells.group_y[std::size_t(g)] * axis[1] +
                          cells.group_z[std::size_t(g)] * axis[2];
    any |= (product > least) & (hidden[g] != 0);
  }
  if (!any) return;
  for (int first = 0; first < cells.groups; first += kLanes) {
    const std::size_t at = std::size_t(first);
    const float *gx = &cells.group_x[at], *gy = &cells.group_y[at], *gz = &cells.group_z[at];
    for (int k = 0; k < kLanes; ++k) near[k] = gx[k] * axis[0] + gy[k] * axis[1] + gz[k] * axis[2];
    if (far) {
      weigh(view, gx, gy, gz, weight);
      for (int k = 0; k < kLanes; ++k) {
        const float w = near[k] > least ? 0 : weight[k] * flux.groups[at + std::size_t(k)];
        all[k] += w;
        lost[k] += w * float(std::popcount(hidden[first + k])) * (1.0f / kLanes);
      }
    }
    for (int j = 0; j < kLanes; ++j) {
      if (!(near[j] > least)) continue;
      const std::size_t cell = std::size_t(first + j) * kLanes;
      weigh(view, &cells.x[cell], &cells.y[cell], &cells.z[cell], weight);
      const int mask = hidden[first + j];
      for (int k = 0; k < kLanes; ++k) {
        const float w = weight[k] * flux.cells[cell + std::size_t(k)];
        all[k] += w;
        lost[k] += (mask >> k) & 1 ? w : 0;
      }
    }
  }
  for (int k = 0; k < kLanes; ++k) sums->all += all[k], sums->lost += lost[k];
}

// Cells along an edge of which two are no wider than the lobe's standard deviation.
int size_for(float width) { return width > 0.75f ? 16 : width > 0.24f ? 32 : kFinest; }

}  // namespace

void glossy_shares(const VertexVisibility& visibility, const CellLight& light,
                   const LobeShape& lobe, std::span<const glm::vec3> vertices,
                   std::span<const glm::vec3> normals, glm::vec3 eye, std::span<glm::vec4> shares) {
  check(visibility.size == light.size(), "light must have the cells of the visibility, ",
        visibility.size, ", got ", light.size());
  check(visibility.vertex_count() == vertices.size() && vertices.size() == normals.size() &&
            shares.size() == visibility.entries(),
        "there must be as many vertices and normals, ", visibility.vertex_count(),
        ", and as many shares as entries, ", visibility.entries(), ", got ", vertices.size(), ", ",
        normals.size(), " and ", shares.size());
  // Sharper ones fall between the middles of cells.
  constexpr float kSharpest = 3600, kWidest = 1e-2f;
  const float exponent = std::clamp(lobe.exponent, kWidest, kSharpest);
  const float width = 2 / std::sqrt(exponent);
  const int size = size_for(width);
  const Cells& cells = cells_of(size);
  const Flux flux = flux_of(light, cells.x.size());
  const float reach = kReach * width + cells.radius;
  const float least = reach < kPi ? std::cos(reach) : -2.0f;
  View common{};
  common.half_exponent = lobe.ggx ? 0 : 0.5f * exponent;
  common.alpha2 = 2 / exponent, common.flatness = 1 - common.alpha2;
  parallel_for(int(shares.size()), kGrain, [&](int begin, int end) {
    HiddenCells hidden(size);
    for (int i = begin; i < end; ++i) {
      const std::size_t e = std::size_t(i), v = e % vertices.size();
      shares[e].w = 1;
      const std::span<const std::uint16_t> edges = visibility.edges_of(e);
      const glm::vec3 n = e == v ? normals[v] : -normals[v], to = eye - vertices[v];
      const float length = glm::length(to);
      if (edges.empty() || !(length > 0) || !std::isfinite(length)) continue;
      glm::vec3 view = to / length;
      const float cosine = glm::dot(n, view);
      if (cosine < kBehind) {
        shares[e].w = kMostTouched;
        continue;
      }
      if (cosine < kGrazing) view = glm::normalize(view + (kGrazing - cosine) * n);
      hidden.set(edges, visibility.size);
      View at = common;
      at.nx = n.x, at.ny = n.y, at.nz = n.z, at.vx = view.x, at.vy = view.y, at.vz = view.z;
      at.nv = std::max(glm::dot(n, view), 1e-3f);
      at.view_mask = std::sqrt(at.alpha2 + at.flatness * at.nv * at.nv);
      const glm::vec3 mirrored = 2 * at.nv * n - view;
      Sums sums;
      add_up(cells, flux, at, &mirrored.x, least, hidden.masks(), lobe.ggx, &sums);
      if (sums.all > 0) shares[e].w = std::clamp(1 - sums.lost / sums.all, 0.0f, kMostTouched);
    }
  });
}

}  // namespace fastibl
