#include "fastibl/shading/lobe_cells.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "fastibl/core/simd.h"
#include "fastibl/scene/octahedral.h"

namespace fastibl {
namespace {

using Cells = LobeCells::Cells;
using Flux = LobeCells::Flux;
using Sums = LobeCells::Sums;

// The cells of a group make up one cell of a grid of a quarter of the size.
constexpr int kLanes = HiddenCells::kGroup;
constexpr int kFinest = 64;  // cells along an edge
constexpr int kMostGroups = kFinest * kFinest / kLanes;
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

Flux flux_of(std::span<const float> of, std::span<const int> without, std::size_t count) {
  std::vector<float> own(of.begin(), of.end());
  for (const int k : without) own[std::size_t(k)] = 0;
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

// Weight of the lobe in some directions: cos θ (n·h)^s, or cos θ D(h)/masking.
template <typename V>
FASTIBL_INLINE V weight_of(const View& view, const float* at_x, const float* at_y,
                           const float* at_z) {
  const V x = floats_at<V>(at_x), y = floats_at<V>(at_y), z = floats_at<V>(at_z);
  const V c = x * view.nx + y * view.ny + z * view.nz;
  const V to_view = x * view.vx + y * view.vy + z * view.vz;
  const V sum = c + view.nv, length2 = 2 + 2 * to_view;
  const V cosine = c > 0 ? c : V{};
  const V half2 = sum * sum / (length2 > 1e-6f ? length2 : V{} + 1e-6f);
  if (view.half_exponent > 0) {
    // (n·h)^s = exp(s/2 ln(1 − u)), five terms of the logarithm's series: 5 % short at u = 0.7.
    const V beside = 1 - half2, u = beside > 0 ? beside : V{};
    const V logarithm = u * (1 + u * (0.5f + u * (1 / 3.0f + u * (0.25f + u * 0.2f))));
    const V of_two = -1.44269504f * view.half_exponent * logarithm;
    const V power = of_two > -80 ? of_two : V{} - 80;
    const auto whole = __builtin_convertvector(power, IntsOf<V>) - 1;
    const V f = power - __builtin_convertvector(whole, V);  // in (0, 1], 1 where power is 0
    const V mantissa =
        1 + f * (0.693147f + f * (0.240227f + f * (0.0558f + f * 0.0096f)));  // 1e-4 off
    return cosine * mantissa * reinterpret_cast<V>((whole + 127) << 23);
  }
  const V d = half2 * (view.alpha2 - 1) + 1;
  V root;
  square_root(view.alpha2 + view.flatness * cosine * cosine, root);
  const V mask = root * view.nv + view.view_mask * cosine;
  return cosine / (d * d * (mask > 1e-6f ? mask : V{} + 1e-6f));
}

// Products of the middles of groups with a lobe's.
template <typename V>
FASTIBL_INLINE V along(const Cells& cells, std::size_t group, const float* axis) {
  return floats_at<V>(&cells.group_x[group]) * axis[0] +
         floats_at<V>(&cells.group_y[group]) * axis[1] +
         floats_at<V>(&cells.group_z[group]) * axis[2];
}

template <typename V>
FASTIBL_INLINE bool any_of(const IntsOf<V>& places) {
  int any = 0;
  for (int k = 0; k < kFloatsIn<V>; ++k) any |= places[k];
  return any != 0;
}

// Some cells of a group that are hidden: all bits set in a float's place. part: the first of them.
template <typename V>
FASTIBL_INLINE IntsOf<V> hidden_in(HiddenCells::Mask mask, int part) {
  IntsOf<V> bits;
  for (int k = 0; k < kFloatsIn<V>; ++k) bits[k] = 1 << k;
  return ((int(mask) >> part) & bits) != 0;
}

// What an object hides from a place between kCorners others.
template <int kCorners>
struct Hidden {
  const HiddenCells::Mask* masks[kCorners];
  float weights[kCorners];
};

// axis: the lobe's middle. Groups whose product with it is above `least` are looked at cell by
// cell. far: whether the others are looked at as a whole. untouched: whether sums are wanted where
// nothing is hidden.
template <typename V, int kCorners>
FASTIBL_INLINE void add_up(const Cells& cells, const Flux& flux, const View& view,
                           const float* axis, float least, const Hidden<kCorners>& hidden, bool far,
                           bool untouched, Sums* sums) {
  constexpr int kWidth = kFloatsIn<V>, kParts = kLanes / kWidth;
  std::uint16_t near[kMostGroups];
  int count = 0, touched = 0;
  for (int first = 0; first < cells.groups; first += kWidth) {
    const auto is_near = along<V>(cells, std::size_t(first), axis) > least;
    if (!any_of<V>(is_near)) continue;
    for (int k = 0; k < kWidth; ++k) {
      near[count] = std::uint16_t(first + k);
      count += is_near[k] & 1;
      touched |= is_near[k] & hidden.masks[0][first + k];
    }
  }
  if (!touched && !far && !untouched) return;
  V all[kParts] = {}, lost[kParts] = {};
  for (int first = 0; far && first < cells.groups; first += kLanes)
    for (int p = 0; p < kParts; ++p) {
      const std::size_t at = std::size_t(first + p * kWidth);
      const V weight =
          weight_of<V>(view, &cells.group_x[at], &cells.group_y[at], &cells.group_z[at]) *
          floats_at<V>(&flux.groups[at]);
      const V w = along<V>(cells, at, axis) > least ? V{} : weight;
      all[p] += w;
      for (int c = 0; c < kCorners; ++c) {
        V part;
        for (int k = 0; k < kWidth; ++k)
          part[k] = float(std::popcount(hidden.masks[c][at + std::size_t(k)]));
        lost[p] += hidden.weights[c] * w * part * (1.0f / kLanes);
      }
    }
  for (int i = 0; i < count; ++i) {
    const int group = near[i];
    for (int p = 0; p < kParts; ++p) {
      const std::size_t at = std::size_t(group * kLanes + p * kWidth);
      const V weight = weight_of<V>(view, &cells.x[at], &cells.y[at], &cells.z[at]) *
                       floats_at<V>(&flux.cells[at]);
      all[p] += weight;
      for (int c = 0; c < kCorners; ++c)
        lost[p] +=
            hidden_in<V>(hidden.masks[c][group], p * kWidth) ? hidden.weights[c] * weight : V{};
    }
  }
  for (int p = 0; p < kParts; ++p) add_each(all[p], sums->all), add_each(lost[p], sums->lost);
}
FASTIBL_BY_WIDTH(void add_up_at_corner(const Cells& cells, const Flux& flux, const View& view,
                                       const float* axis, float least, const Hidden<1>& hidden,
                                       bool far, bool untouched, Sums* sums),
                 add_up<V, 1>(cells, flux, view, axis, least, hidden, far, untouched, sums))
// Places between corners are mostly asked only where one of the corners meets the object.
FASTIBL_BY_WIDTH(void add_up_between(const Cells& cells, const Flux& flux, const View& view,
                                     const float* axis, float least, const Hidden<3>& hidden,
                                     bool far, Sums* sums),
                 add_up<V, 3>(cells, flux, view, axis, least, hidden, far, true, sums))

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

LobeCells::LobeCells(const CellLight& light, const LobeShape& lobe, std::span<const int> without)
    : LobeCells(light.flux(), lobe, without) {}

LobeCells::LobeCells(std::span<const float> flux, const LobeShape& lobe,
                     std::span<const int> without) {
  const Reach at = reach_of(lobe);
  size_ = at.size, cells_ = at.cells, least_ = at.least;
  flux_ = flux_of(flux, without, cells_->x.size());
  const float exponent = at.exponent;
  ggx_ = lobe.ggx;
  half_exponent_ = ggx_ ? 0 : 0.5f * exponent;
  alpha2_ = 2 / exponent;
}

// add_up: sums for a View and the lobe's middle.
template <typename AddUp>
LobeCells::Sums LobeCells::summed(glm::vec3 n, glm::vec3 view, const AddUp& add_up) const {
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
  return sums;
}

float LobeCells::Sums::share() const {
  return all > 0 ? std::clamp(1 - lost / all, 0.0f, kMostTouched) : 1.0f;
}

float LobeCells::share(glm::vec3 n, glm::vec3 view, const HiddenCells::Mask* hidden) const {
  return at_corner(n, view, hidden, false).share();
}

LobeCells::Sums LobeCells::sums(glm::vec3 n, glm::vec3 view,
                                const HiddenCells::Mask* hidden) const {
  return at_corner(n, view, hidden, true);
}

LobeCells::Sums LobeCells::at_corner(glm::vec3 n, glm::vec3 view, const HiddenCells::Mask* hidden,
                                     bool untouched) const {
  return summed(n, view, [&](const View& at, const float* axis, Sums& sums) {
    add_up_at_corner(*cells_, flux_, at, axis, least_, {{hidden}, {1}}, ggx_, untouched, &sums);
  });
}

float LobeCells::share(glm::vec3 n, glm::vec3 view, const Corners& corners) const {
  return sums(n, view, corners).share();
}

LobeCells::Sums LobeCells::sums(glm::vec3 n, glm::vec3 view, const Corners& corners) const {
  const auto& [hidden, weights] = corners;
  return summed(n, view, [&](const View& at, const float* axis, Sums& sums) {
    add_up_between(*cells_, flux_, at, axis, least_,
                   {{hidden[0], hidden[1], hidden[2]}, {weights.x, weights.y, weights.z}}, ggx_,
                   &sums);
  });
}

}  // namespace fastibl
