#include "fastibl/shading/lobe_cells.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "fastibl/core/simd.h"
#include "fastibl/scene/octahedral.h"

namespace fastibl {
// Middles of the cells of one grid in the order of the curve, and of its groups of 16.
struct LobeCells::Cells {
  int groups = 0;
  std::vector<float> x, y, z, group_x, group_y, group_z;
  float radius = 0;  // of a group, radians, from its middle
};

namespace {

using Cells = LobeCells::Cells;
using Flux = LobeCells::Flux;

// The cells of a group make up one cell of a grid of a quarter of the size.
constexpr int kLanes = HiddenCells::kGroup;
constexpr int kFinest = 64;     // cells along an edge
constexpr float kReach = 2.2f;  // of a Blinn lobe, standard deviations

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
  return all[size / 32];  // 16, 32, 64: 0, 1, 2
}

Flux flux_of(const CellLight& light, std::size_t count) {
  const std::vector<float>& own = light.flux();
  Flux flux{std::vector<float>(count, 0.0f), std::vector<float>(count / kLanes, 0.0f)};
  const std::size_t finer = std::max(count, own.size());
  const float part = float(own.size()) / float(finer);  // of a cell of the light
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

// What an object hides from a place between kCorners others.
template <int kCorners>
struct Hidden {
  const HiddenCells::Mask* masks[kCorners];
  float weights[kCorners];
};

// axis: the lobe's middle. Groups whose product with it is above `least` are looked at cell by
// cell. far: whether the others are looked at as a whole.
template <int kCorners>
FASTIBL_INLINE void add_up(const Cells& cells, const Flux& flux, const View& view,
                           const float* axis, float least, const Hidden<kCorners>& hidden, bool far,
                           Sums* sums) {
  float all[kLanes] = {}, lost[kLanes] = {};
  float near[kLanes], weight[kLanes];
  // Places between corners are mostly asked only where one of the corners meets the object.
  int any = far || kCorners > 1;
  for (int g = 0; g < cells.groups && kCorners == 1; ++g) {
    const float product = cells.group_x[std::size_t(g)] * axis[0] +
                          cells.group_y[std::size_t(g)] * axis[1] +
                          cells.group_z[std::size_t(g)] * axis[2];
    any |= (product > least) & (hidden.masks[0][g] != 0);
  }
  if (!any) return;
  for (int first = 0; first < cells.groups; first += kLanes) {
    const std::size_t at = std::size_t(first);
    const float *gx = &cells.group_x[at], *gy = &cells.group_y[at], *gz = &cells.group_z[at];
    int some = far;
    for (int k = 0; k < kLanes; ++k) {
      near[k] = gx[k] * axis[0] + gy[k] * axis[1] + gz[k] * axis[2];
      some |= near[k] > least;
    }
    if (!some) continue;
    if (far) {
      weigh(view, gx, gy, gz, weight);
      for (int k = 0; k < kLanes; ++k) {
        const float w = near[k] > least ? 0 : weight[k] * flux.groups[at + std::size_t(k)];
        all[k] += w;
        for (int c = 0; c < kCorners; ++c)
          lost[k] += hidden.weights[c] * w * float(std::popcount(hidden.masks[c][first + k])) *
                     (1.0f / kLanes);
      }
    }
    for (int j = 0; j < kLanes; ++j) {
      if (!(near[j] > least)) continue;
      const std::size_t cell = std::size_t(first + j) * kLanes;
      weigh(view, &cells.x[cell], &cells.y[cell], &cells.z[cell], weight);
      for (int k = 0; k < kLanes; ++k) {
        weight[k] *= flux.cells[cell + std::size_t(k)];
        all[k] += weight[k];
      }
      for (int c = 0; c < kCorners; ++c) {
        const int mask = hidden.masks[c][first + j];
        if (mask == 0) continue;
        const float part = hidden.weights[c];
        for (int k = 0; k < kLanes; ++k) lost[k] += (mask >> k) & 1 ? part * weight[k] : 0;
      }
    }
  }
  for (int k = 0; k < kLanes; ++k) sums->all += all[k], sums->lost += lost[k];
}
FASTIBL_CLONES void add_up_at_corner(const Cells& cells, const Flux& flux, const View& view,
                                     const float* axis, float least, const Hidden<1>& hidden,
                                     bool far, Sums* sums) {
  add_up<1>(cells, flux, view, axis, least, hidden, far, sums);
}
FASTIBL_CLONES void add_up_between(const Cells& cells, const Flux& flux, const View& view,
                                   const float* axis, float least, const Hidden<3>& hidden,
                                   bool far, Sums* sums) {
  add_up<3>(cells, flux, view, axis, least, hidden, far, sums);
}

// Cells along an edge of which two are no wider than the lobe's standard deviation.
int size_for(float width) { return width > 0.75f ? 16 : width > 0.24f ? 32 : kFinest; }

// A lobe's exponent, the cells that it is summed over, and the cosine of its reach.
struct Reach {
  float exponent, least;
  int size;
  const Cells* cells;
};
Reach reach_of(const LobeShape& lobe) {
  // Sharper lobes fall between the middles of cells.
  constexpr float kSharpest = 3600, kWidest = 1e-2f;
  Reach at{};
  at.exponent = std::clamp(lobe.exponent, kWidest, kSharpest);
  const float width = 2 / std::sqrt(at.exponent);
  at.size = size_for(width);
  at.cells = &cells_of(at.size);
  const float reach = kReach * width + at.cells->radius;
  at.least = reach < kPi ? std::cos(reach) : -2.0f;
  return at;
}

}  // namespace

double lobe_groups(const std::optional<LobeShape>& lobe) {
  if (!lobe) return 0;
  const Reach at = reach_of(*lobe);
  const double near = std::min(0.5 * (1 - double(at.least)), 1.0) * at.cells->groups;
  // In a GGX lobe's tail, groups are cells of a coarser grid.
  return 1 + near + (lobe->ggx ? (at.cells->groups - near) / kLanes : 0);
}

LobeCells::LobeCells(const CellLight& light, const LobeShape& lobe) {
  const Reach at = reach_of(lobe);
  size_ = at.size, cells_ = at.cells, least_ = at.least;
  flux_ = flux_of(light, cells_->x.size());
  const float exponent = at.exponent;
  ggx_ = lobe.ggx;
  half_exponent_ = ggx_ ? 0 : 0.5f * exponent;
  alpha2_ = 2 / exponent;
}

// add_up: sums for a View and the lobe's middle.
template <typename AddUp>
float LobeCells::summed(glm::vec3 n, glm::vec3 view, const AddUp& add_up) const {
  constexpr float kGrazing = 0.02f;
  const float cosine = glm::dot(n, view);
  if (cosine < kGrazing) view = glm::normalize(view + (kGrazing - cosine) * n);
  View at{};
  at.half_exponent = half_exponent_, at.alpha2 = alpha2_, at.flatness = 1 - alpha2_;
  at.nx = n.x, at.ny = n.y, at.nz = n.z, at.vx = view.x, at.vy = view.y, at.vz = view.z;
  at.nv = std::max(glm::dot(n, view), 1e-3f);
  at.view_mask = std::sqrt(at.alpha2 + at.flatness * at.nv * at.nv);
  const glm::vec3 mirrored = 2 * at.nv * n - view;
  Sums sums;
  add_up(at, &mirrored.x, sums);
  return sums.all > 0 ? std::clamp(1 - sums.lost / sums.all, 0.0f, kMostTouched) : 1.0f;
}

float LobeCells::share(glm::vec3 n, glm::vec3 view, const HiddenCells::Mask* hidden) const {
  return summed(n, view, [&](const View& at, const float* axis, Sums& sums) {
    add_up_at_corner(*cells_, flux_, at, axis, least_, {{hidden}, {1}}, ggx_, &sums);
  });
}

float LobeCells::share(glm::vec3 n, glm::vec3 view, const Corners& corners) const {
  const auto& [hidden, weights] = corners;
  return summed(n, view, [&](const View& at, const float* axis, Sums& sums) {
    add_up_between(*cells_, flux_, at, axis, least_,
                   {{hidden[0], hidden[1], hidden[2]}, {weights.x, weights.y, weights.z}}, ggx_,
                   &sums);
  });
}

}  // namespace fastibl
