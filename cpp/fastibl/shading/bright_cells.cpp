#include "fastibl/shading/bright_cells.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <span>

#include "fastibl/core/lanes.h"
#include "fastibl/scene/octahedral.h"

namespace fastibl {
namespace {

// Rays to a cell: the first ones tell whether it is hidden in part, and only then the rest go, too.
constexpr std::size_t kLeastRays = 4, kFirstRays = 8, kMostRays = 32;
constexpr float kRayShare = 0.005f;  // of all light, for which there is a ray
constexpr float kLow = -0.05f;       // cosine below which a cell counts as below the horizon
// Of cells this bright, nearly grazing light is asked for everywhere: the tangent plane of a vertex
// differs from that of a place between vertices.
constexpr float kStrong = 0.1f, kGrazing = 0.1f;

bool is_hidden(const HiddenCells::Mask* masks, int cell) {
  return masks[cell / HiddenCells::kGroup] >> (cell % HiddenCells::kGroup) & 1;
}

// A square that lies in a cell, perhaps with a part of its light.
struct CellSquare {
  int face, x, y;
  float flux;
};

// Chooses directions for equal parts of the light of some squares, then texel by texel from a level
// to the finest: Clarberg et al. 2005, Wavelet Importance Sampling, section 5.
class Warp {
 public:
  // squares: along a face's edge; those of a level, or finer ones where the map has none.
  Warp(const CubeMap& map, int level, int squares)
      : map_(map), level_(level), finest_(level), squares_(squares) {
    while (finest_ > 0 && squares == map.level(level).size() &&
           map.level(finest_ - 1).size() == 2 * map.level(finest_).size())
      --finest_;
  }

  // part: of all light of the squares, in [0, 1]. number: another one for each call; tells where in
  // the finest texel, by Roberts' R2 sequence.
  glm::vec3 direction(std::span<const CellSquare> squares, float part, int number) const {
    float left = 0;
    for (const CellSquare& s : squares) left += part * s.flux;
    std::size_t i = 0;
    while (i + 1 < squares.size() && left > squares[i].flux) left -= squares[i++].flux;
    int face = squares[i].face, x = squares[i].x, y = squares[i].y, n = squares_;
    part = std::min(left / squares[i].flux, 1.0f);
    for (int k = level_ - 1; k >= finest_; --k) {
      float flux[4], all = 0;
      for (int c = 0; c < 4; ++c) all += flux[c] = flux_of(k, face, 2 * x + c % 2, 2 * y + c / 2);
      left = part * all;
      int c = 0;
      while (c < 3 && left > flux[c]) left -= flux[c++];
      part = flux[c] > 0 ? std::min(left / flux[c], 1.0f) : 0.5f;
      x = 2 * x + c % 2, y = 2 * y + c / 2, n *= 2;
    }
    const double aside = number * 0.7548776662466927, down = number * 0.5698402909980532;
    return glm::normalize(face_direction(face, float((x + aside - std::floor(aside)) / n),
                                         float((y + down - std::floor(down)) / n)));
  }

 private:
  float flux_of(int level, int face, int x, int y) const {
    const glm::vec3& t = map_.level(level).texel(face, x, y);
    return (t.x + t.y + t.z) * float(texel_solid_angle(x, y, map_.level(level).size()));
  }

  const CubeMap& map_;
  int level_, finest_, squares_;
};

// The brightest cells, in order.
std::vector<int> brightest(const std::vector<float>& flux) {
  std::vector<int> cells;
  for (std::size_t k = 0; k < flux.size(); ++k)
    if (flux[k] >= BrightCells::kLeastShare) cells.push_back(int(k));
  if (cells.size() > BrightCells::kMost) {
    std::ranges::nth_element(cells, cells.begin() + BrightCells::kMost, [&](int a, int b) {
      const float at_a = flux[std::size_t(a)], at_b = flux[std::size_t(b)];
      return at_a != at_b ? at_a > at_b : a < b;
    });
    cells.resize(BrightCells::kMost);
    std::ranges::sort(cells);
  }
  return cells;
}

}  // namespace

BrightCells::BrightCells(const CubeMap& map, const CellLight& light,
                         const glm::mat3& light_from_map, const glm::mat3& rays_from_light)
    : size_(light.size()) {
  std::vector<int> slots(light.flux().size(), -1);
  const std::vector<int> bright = brightest(light.flux());
  for (std::size_t i = 0; i < bright.size(); ++i) slots[std::size_t(bright[i])] = int(i);
  int level = 0;
  while (map.level(level).size() > light.level_size()) ++level;
  std::vector<std::vector<CellSquare>> squares(bright.size());
  const int parts = light.squares() / light.level_size();
  light.each_square([&](int face, int x, int y, float solid_angle, int cell) {
    const int slot = slots[std::size_t(cell)];
    if (slot < 0) return;
    const glm::vec3& radiance = map.level(level).texel(face, x / parts, y / parts);
    const float flux = (radiance.x + radiance.y + radiance.z) * solid_angle;
    if (flux > 0) squares[std::size_t(slot)].push_back({face, x, y, flux});
  });
  const Warp warp(map, level, light.squares());
  for (std::size_t i = 0; i < bright.size(); ++i) {
    if (squares[i].empty()) continue;
    indices_.push_back(bright[i]);
    const float share = light.flux()[std::size_t(bright[i])];
    const auto wanted = std::size_t(share / kRayShare);
    Cell& cell = cells_.emplace_back();
    cell.direction = octahedral_grid(size_).directions()[std::size_t(bright[i])];
    cell.share = share;
    cell.doubtful = share >= kStrong ? kGrazing : kLow;
    cell.first = rays_.size();
    cell.count = std::bit_ceil(std::clamp(wanted, kLeastRays, kMostRays));
    cell.first_count = std::min(cell.count, kFirstRays);
    const CellLight::Sum &before = light.before(bright[i]), &after = light.before(bright[i] + 1);
    for (int axis = 0; axis < 3; ++axis)
      for (int c = 0; c < 3; ++c)
        cell.moments[c][axis] = after.values[4 * axis + c] - before.values[4 * axis + c];
    // The first rays go all over the cell, too.
    const std::size_t apart = cell.count / cell.first_count;
    for (std::size_t k = 0; k < cell.count; ++k) {
      const std::size_t at = k % cell.first_count * apart + k / cell.first_count;
      const float part = (float(at) + 0.5f) / float(cell.count);
      const glm::vec3 d = light_from_map * warp.direction(squares[i], part, int(rays_.size()));
      rays_.push_back(rays_from_light * d);
      lit_rays_.add(d, share / float(cell.count));
    }
    lit_cells_.add(cell.direction, share);
  }
  lit_rays_.pad(), lit_cells_.pad();
}

void BrightCells::Lit::add(glm::vec3 d, float f) {
  x.push_back(d.x), y.push_back(d.y), z.push_back(d.z), flux.push_back(f);
}

void BrightCells::Lit::pad() {
  while (x.size() % std::size_t(kLanes) != 0) add({x.back(), y.back(), z.back()}, 0);
  none.assign(x.size(), 0.0f);
}

LitDirections BrightCells::Lit::directions(const std::vector<float>& of) const {
  return {x.data(), y.data(), z.data(), none.data(), {of.data(), none.data(), none.data()},
          x.size()};
}

CellStates BrightCells::states(const HiddenCells::Mask* hidden, glm::vec3 normal) const {
  const OctahedralGrid& grid = octahedral_grid(size_);
  CellStates states;
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    const Cell& cell = cells_[i];
    const std::uint64_t bit = std::uint64_t{1} << i;
    const bool here = is_hidden(hidden, indices_[i]);
    if (here) states.hidden |= bit;
    const float cosine = glm::dot(cell.direction, normal);
    if (cosine < kLow) {
      states.low |= bit;
      continue;
    }
    if (!here) states.free |= bit;
    bool alike = cosine >= cell.doubtful;
    const std::uint16_t* beside = grid.neighbours(indices_[i]);
    for (int k = 0; k < 8 && alike; ++k)
      alike = is_hidden(hidden, beside[k]) == here ||
              glm::dot(grid.directions()[beside[k]], normal) < 0;
    if (!alike) states.mixed |= bit;
  }
  return states;
}

std::uint64_t BrightCells::unsure(const CellStates& a, const CellStates& b, const CellStates& c) {
  const std::uint64_t hidden = (a.hidden & ~a.low) | (b.hidden & ~b.low) | (c.hidden & ~c.low),
                      free = a.free | b.free | c.free, mixed = a.mixed | b.mixed | c.mixed;
  return mixed | (hidden & free);
}

namespace {

// Traces rays from several places at once.
class Tracer {
 public:
  // directions: of all rays, unit.
  Tracer(const Bvh& bvh, std::span<const glm::vec3> starts, std::span<const glm::vec3> directions)
      : bvh_(bvh), starts_(starts), all_(directions) {
    for (std::vector<std::size_t>& l : lists()) l.clear();
  }
  void ask(std::size_t start, std::size_t ray) { lists()[start].push_back(ray); }
  // Calls met(ray, hidden) for all that were asked for. Returns how many.
  template <typename Met>
  int answer(Met&& met) {
    thread_local DirectionSet set(0);
    thread_local std::vector<std::uint8_t> hidden;
    int count = 0;
    for (std::size_t s = 0; s < starts_.size(); ++s) {
      std::vector<std::size_t>& rays = lists()[s];
      if (rays.empty()) continue;
      set.resize(int(rays.size()));
      for (std::size_t i = 0; i < rays.size(); ++i) set.set(int(i), all_[rays[i]]);
      hidden.resize(rays.size());
      bvh_.occluded(starts_[s], set, 0, hidden);
      for (std::size_t i = 0; i < rays.size(); ++i) met(rays[i], hidden[i] != 0);
      count += set.count;
      rays.clear();
    }
    return count;
  }

 private:
  static std::array<std::vector<std::size_t>, BrightCells::kStarts>& lists() {
    thread_local std::array<std::vector<std::size_t>, BrightCells::kStarts> lists;
    return lists;
  }

  const Bvh& bvh_;
  std::span<const glm::vec3> starts_, all_;
};

}  // namespace

int BrightCells::look(const Bvh& bvh, std::span<const glm::vec3> starts, glm::vec3 normal,
                      const Corners& corners, std::uint64_t asked, Seen& seen) const {
  std::uint64_t hidden = 0;
  for (const Corner& c : corners) hidden |= c.states.hidden & ~c.states.low;
  seen.free.resize(lit_rays_.x.size());
  std::uint64_t traced = 0;
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    const Cell& cell = cells_[i];
    seen.lost[i] = float(hidden >> i & 1);
    if (asked >> i & 1 && glm::dot(normal, cell.direction) > kLow)
      traced |= std::uint64_t{1} << i;
    else
      std::fill_n(&seen.free[cell.first], cell.count, std::uint8_t(~hidden >> i & 1));
  }
  if (traced == 0) return 0;
  const auto each = [&](std::uint64_t which, auto&& visit) {
    for (; which != 0; which &= which - 1) {
      const auto i = std::size_t(std::countr_zero(which));
      visit(i, cells_[i]);
    }
  };
  // First from two of four starts, which lie across from each other.
  const bool several = starts.size() == kStarts;
  Tracer tracer(bvh, starts, rays_);
  each(traced, [&](std::size_t, const Cell& cell) {
    for (std::size_t r = 0; r < cell.first_count; ++r)
      tracer.ask(several && r % 2 == 1 ? 3 : 0, cell.first + r);
  });
  int count = tracer.answer([&](std::size_t ray, bool met) { seen.free[ray] = !met; });
  std::uint64_t partly = 0;
  each(traced, [&](std::size_t i, const Cell& cell) {
    const std::uint8_t* free = &seen.free[cell.first];
    const auto lost = std::size_t(std::count(free, free + cell.first_count, std::uint8_t{0}));
    seen.lost[i] = float(lost) / float(cell.first_count);
    if (lost > 0 && lost < cell.first_count)
      partly |= std::uint64_t{1} << i;
    else
      std::fill_n(&seen.free[cell.first], cell.count, std::uint8_t(lost == 0));
  });
  // Then all rays; and where there are few, those again from the other two starts.
  each(partly, [&](std::size_t, const Cell& cell) {
    if (cell.count == cell.first_count)
      for (std::size_t r = 0; several && r < cell.count; ++r) tracer.ask(1 + r % 2, cell.first + r);
    for (std::size_t r = cell.first_count; r < cell.count; ++r)
      tracer.ask(several ? (r + 1) % kStarts : 0, cell.first + r);
  });
  std::vector<std::uint8_t>& other = seen.other;
  other.resize(lit_rays_.x.size());
  count += tracer.answer([&](std::size_t ray, bool met) { other[ray] = !met; });
  each(partly, [&](std::size_t i, const Cell& cell) {
    std::uint8_t *free = &seen.free[cell.first], *then = &other[cell.first];
    const auto lost = [&](const std::uint8_t* of, std::size_t n) {
      return float(std::count(of, of + n, std::uint8_t{0}));
    };
    if (cell.count > cell.first_count) {
      std::copy(then + cell.first_count, then + cell.count, free + cell.first_count);
      seen.lost[i] = lost(free, cell.count) / float(cell.count);
    } else if (several) {
      seen.lost[i] = 0.5f * (seen.lost[i] + lost(then, cell.count) / float(cell.count));
    }
  });
  return count;
}

glm::vec3 BrightCells::change(const Seen& seen, glm::vec3 normal, const Corners& corners,
                              glm::vec3 weights, const std::array<glm::vec3, 4>& irradiance,
                              glm::vec3 free, std::uint64_t asked) const {
  glm::vec3 back(0), lost(0);
  for (; asked != 0; asked &= asked - 1) {
    const int i = std::countr_zero(asked);
    const Cell& cell = cells_[std::size_t(i)];
    for (int k = 0; k < 3; ++k) {
      const Corner& corner = corners[std::size_t(k)];
      if (corner.states.hidden >> i & 1)
        back += weights[k] * share_of(corner.normal * cell.moments, irradiance[std::size_t(k)]);
    }
    const glm::vec3 open = glm::max(normal * cell.moments, glm::vec3(0));
    lost += seen.lost[std::size_t(i)] * share_of(open, irradiance[3]);
  }
  return glm::min(back, glm::max(1.0f - free, glm::vec3(0))) - lost;
}

std::uint64_t BrightCells::counted(glm::vec3 normal, glm::vec3 view, const LobeHeight& lobe,
                                   float rest) const {
  if (cells_.empty()) return 0;
  std::array<float, kMost> weights;
  static_assert(kMost % kLanes == 0);
  weigh_squares(lit_cells_.directions(lit_cells_.flux), width(), normal, view, lobe,
                weights.data());
  float all = rest;
  for (std::size_t i = 0; i < cells_.size(); ++i) all += weights[i];
  std::uint64_t result = 0;
  for (std::size_t i = 0; i < cells_.size(); ++i)
    if (weights[i] > kCounts * all) result |= std::uint64_t{1} << i;
  return result;
}

// In a disc, or on its rim, of which texels are cut.
bool BrightCells::Lit::within(std::size_t i, glm::vec3 direction, float sin_radius) const {
  constexpr float kRim = 1.1f;
  const float sine = std::min(kRim * sin_radius, 1.0f);
  return direction.x * x[i] + direction.y * y[i] + direction.z * z[i] >= std::sqrt(1 - sine * sine);
}

float BrightCells::leave_out(glm::vec3 direction, float sin_radius) {
  float out = 0;
  for (std::size_t i = 0; i < cells_.size(); ++i)
    for (std::size_t r = cells_[i].first; r < cells_[i].first + cells_[i].count; ++r) {
      if (!lit_rays_.within(r, direction, sin_radius)) continue;
      out += lit_rays_.flux[r];
      lit_cells_.flux[i] = std::max(lit_cells_.flux[i] - lit_rays_.flux[r], 0.0f);
      lit_rays_.flux[r] = 0;
    }
  return out;
}

std::uint64_t BrightCells::parts_towards(glm::vec3 direction, float sin_radius,
                                         std::array<float, kMost>& parts) const {
  // Rays have equal parts of their cell's light, so they tell how much of it lies in the disc. A
  // few are some other light's.
  constexpr float kLeast = 0.25f;
  parts.fill(0);
  std::uint64_t found = 0;
  float all = 0;
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    const Cell& cell = cells_[i];
    int inside = 0;
    for (std::size_t r = cell.first; r < cell.first + cell.count; ++r)
      inside += lit_rays_.within(r, direction, sin_radius);
    const float part = float(inside) / float(cell.count);
    if (part < kLeast) continue;
    found |= std::uint64_t{1} << i;
    all += parts[i] = part * cell.share;
  }
  for (float& part : parts) part = all > 0 ? part / all : 0;
  return found;
}

float BrightCells::width() const { return std::sqrt(4 * kPi) / float(std::max(size_, 1)); }

LobeCells::Sums BrightCells::lobe_sums(const Seen& seen, glm::vec3 normal, glm::vec3 view,
                                       const LobeHeight& lobe, std::uint64_t counted,
                                       int& looked) const {
  thread_local std::vector<float> flux;  // of these cells alone
  flux.assign(lit_rays_.x.size(), 0);
  LobeCells::Sums result;
  LightSums sums;
  const auto add = [&](std::size_t first, std::size_t end) {
    LitDirections lit = lit_rays_.directions(flux);
    lit.x += first, lit.y += first, lit.z += first, lit.solid_angles += first;
    for (const float*& channel : lit.channels) channel += first;
    lit.count = end - first;
    sum_light(lit, &seen.free[first], normal, view, lobe, sums);
    result.all += sums.open_lobe[0], result.lost += sums.open_lobe[0] - sums.lobe[0];
    looked += int(lit.count);
  };
  // Whole Lanes at once, and neighbours together.
  std::size_t first = 0, end = 0;
  for (; counted != 0; counted &= counted - 1) {
    const Cell& cell = cells_[std::size_t(std::countr_zero(counted))];
    std::copy_n(&lit_rays_.flux[cell.first], cell.count, &flux[cell.first]);
    constexpr std::size_t lanes = kLanes;
    const std::size_t from = cell.first / lanes * lanes;
    if (from > end) {
      if (end > first) add(first, end);
      first = from;
    }
    end = (cell.first + cell.count + lanes - 1) / lanes * lanes;
  }
  if (end > first) add(first, end);
  return result;
}

}  // namespace fastibl
