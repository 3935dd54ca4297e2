#include "fastibl/shadow/mesh_shadow_light.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/shadow_look_up.h"
#include "fastibl/shadow/map_border.h"
#include "fastibl/shadow/plane_rows.h"

namespace fastibl {
namespace {

constexpr int kBlock = SparseCover::kBlock, kTexels = kBlock * kBlock;
// What rounding leaves of a ratio of 0: sums of up to a thousand terms in float err by less.
constexpr float kNothing = 2e-5f;
constexpr double kLeastLight = 1e-36;  // of a channel: the inverse of less is no float
constexpr float kSuddenly = 0.25f;     // share of the light that moved: new directions at once
// Part of a fade for the share of the light that moves meanwhile: two sets of directions differ by
// up to 0.04 in a ratio, so the fade changes it by less than the light itself does.
constexpr float kPace = 4;
constexpr float kUnfaded = 0.85f;  // of the outer map
// Texels: a shadow that has moved no farther may stay. Each direction has its own limit, up to
// this, so that the directions of one lamp are not all drawn anew in the same frame.
constexpr float kShifted = 0.25f;

float most_shift(std::size_t direction) {
  const double part = 0.618033988749895 * double(direction);  // golden ratio: evenly spread
  return kShifted * (0.25f + 0.75f * float(part - std::floor(part)));
}

// From blocks, as SparseCover has them, to rows of pixels.
Image<float> unblocked(std::span<const float> lost, int size) {
  Image<float> image(size, size, 3);
  const int across = (size + kBlock - 1) / kBlock;
  for (int y = 0; y < size; ++y) {
    const float* block =
        &lost[std::size_t(y / kBlock * across) * 3 * kTexels + std::size_t(y % kBlock * kBlock)];
    float* out = image.row(y);
    for (int left = 0; left < size; left += kBlock, block += 3 * kTexels, out += 3 * kBlock)
      for (int x = 0; x < std::min(kBlock, size - left); ++x)
        for (int c = 0; c < 3; ++c) out[3 * x + c] = block[kTexels * c + x];
  }
  return image;
}

std::vector<float> no_loss(int size) {
  const std::size_t across = std::size_t((size + kBlock - 1) / kBlock);
  return std::vector<float>(across * across * 3 * kTexels, 0.0f);
}

void to_ratio(Image<float>& lost) {
  for (float& r : lost.data) {
    r = 1 - r;
    r = r < kNothing ? 0 : r;
  }
}

// How far apart two projections put the shadow of what is at most `top` high and falls within
// `reach` of the middle.
float shift_between(const PlaneProjection& a, const PlaneProjection& b, float top, float reach) {
  const float turned = glm::length(a.slope - b.slope),
              nearer = std::fabs(a.inverse_height - b.inverse_height);
  if (turned == 0 && nearer == 0) return 0;
  const float scale = 1 - top * std::max(a.inverse_height, b.inverse_height);
  return scale > 0 ? top * (turned + reach * nearer) / scale
                   : std::numeric_limits<float>::infinity();
}

// Adds what the object's own maps, which lie along its axes, have where the texels of `image` are.
void add_turned(const ShadowLookUp& soft, float extent, const PlaneMotion& turn,
                Image<float>& image) {
  const PlaneGrid grid{image.width, {0, 0}, extent};
  const PlaneMotion back = turn.inverse();
  std::vector<glm::vec2> points(std::size_t(image.width));
  std::vector<glm::vec3> ratios(points.size());
  for (int y = 0; y < image.height; ++y) {
    grid.points(0, y, points);
    for (glm::vec2& p : points) p = back * p;
    soft.sample(points, ratios);
    float* row = image.row(y);
    for (std::size_t i = 0; i < 3 * points.size(); ++i) row[i] += 1 - (&ratios[0].x)[i];
  }
}

}  // namespace

void MeshShadowLight::update(const CubeMap& radiance) {
  bool stale = splits_ == 0 || now_.split.size() != radiance.size();
  float missed = 1, step = 1;
  if (!stale) {
    SkySplit::Weights weights = now_.split.weigh(radiance);
    step = std::max(1.0f / kFadeCasts, kPace * now_.split.moved(now_.weights, weights));
    now_.weights = std::move(weights);
    missed = now_.split.misfit(now_.weights);
    stale = missed > 0;
  }
  if (before_) {
    fade_ += step;
    if (fade_ >= 1 || before_->split.size() != radiance.size())
      before_.reset();
    else
      before_->weights = before_->split.weigh(radiance);
  }
  // A fade that has not ended goes on first: its sets differ, and nothing may jump.
  if (!stale || (before_ && missed < kSuddenly)) return;
  if (missed < kSuddenly) {
    fade_ = step;
    before_ = std::move(now_);
  } else {
    before_.reset();
  }
  now_ = Set{};
  now_.split = SkySplit(radiance, options_);
  now_.weights = now_.split.weigh(radiance);
  now_.compact = fine_ > 0 ? now_.split.compact(kCompactShare) : std::vector<int>();
  ++splits_;
}

void MeshShadowLight::place_lights(const NearLights& near_lights, const PlaneMotion& motion) {
  near_ = NearPlane(near_lights);
  for (Set* set : {&now_, before_ ? &*before_ : nullptr}) {
    if (!set) continue;
    if (motion.cos_sin != motion_.cos_sin) set->drawn_from.clear();
    set->near_light.clear();
    for (const glm::vec3& d : set->split.directions()) set->near_light.push_back(near_.light_of(d));
  }
  motion_ = motion;
}

PlaneProjection MeshShadowLight::projection(const Set& set, std::size_t k) const {
  const glm::vec3 d = set.split.directions()[k];
  const int light = set.near_light[k];
  return light < 0 ? along(d) : near_.projection(d, light, motion_.shift);
}

// Directions whose shadows were not drawn yet, or lie elsewhere now: near lights are known better,
// and the object is shifted under them.
std::vector<int> MeshShadowLight::stale_directions(const Set& set, const MeshShadow& shadow) const {
  const std::size_t count = set.split.directions().size();
  std::vector<int> stale;
  const bool fine = fine_map_.extent > 0;
  const float top = shadow.triangles().box().upper.z, reach = shadow.inner().extent;
  const auto texel = float((fine ? fine_map_ : shadow.inner()).texel());
  for (std::size_t k = 0; k < count; ++k) {
    if (k >= set.drawn_from.size() || !(shift_between(set.drawn_from[k], projection(set, k), top,
                                                      reach) <= most_shift(k) * texel))
      stale.push_back(int(k));
  }
  return stale;
}

void MeshShadowLight::draw_directions(const ShadowTriangles& triangles, const Set& set,
                                      std::span<const int> chosen, const PlaneGrid& grid,
                                      std::vector<SparseCover::Source>& parts) const {
  parallel_for(int(chosen.size()), 4, [&](int begin, int end) {
    ShadowTriangles::Scratch scratch;
    PlaneBits image(grid.size);
    for (int i = begin; i < end; ++i) {
      const auto k = std::size_t(chosen[std::size_t(i)]);
      image.clear();
      triangles.draw(projection(set, k), grid, image, scratch);
      parts[k] = SparseCover::source({&image, 1});
    }
  });
}

// The grid around the shadows that the compact lights of both sets cast; of extent 0 where it would
// be hardly finer than the map, or reach beyond all.
PlaneGrid MeshShadowLight::fine_grid(const MeshShadow& shadow, const ShadowTriangles& triangles) {
  const Bounds box = triangles.box();
  glm::vec2 lower(std::numeric_limits<float>::infinity()), upper(-lower);
  for (Set* set : {&now_, before_ ? &*before_ : nullptr})
    for (std::size_t k = 0; set && fine_ > 0 && k < set->compact.size(); ++k) {
      const PlaneProjection light = projection(*set, std::size_t(set->compact[k]));
      // A light as low as the object throws its shadow beyond all.
      if (!(box.upper.z * light.inverse_height < 0.99f)) return {fine_, {0, 0}, 0};
      for (const float z : {0.0f, box.upper.z}) {
        const float scale = 1 / (1 - z * light.inverse_height);
        lower = glm::min(lower, scale * (glm::vec2(box.lower) - z * light.slope));
        upper = glm::max(upper, scale * (glm::vec2(box.upper) - z * light.slope));
      }
    }
  if (!(lower.x < upper.x)) return {fine_, {0, 0}, 0};
  const glm::vec2 half = 0.5f * (upper - lower), centre = 0.5f * (upper + lower);
  const PlaneMotion turn = motion_.turn();
  const glm::vec2 off = glm::abs(centre - turn * shadow.inner().centre);
  const auto reach = [&](float extent) { return std::max(off.x, off.y) + extent; };
  // The other maps spread the shadow by a texel.
  const float most = std::max(half.x, half.y);
  const bool within = reach(most) < shadow.inner().extent;
  const double texel = (within ? shadow.inner() : shadow.outer()).texel();
  const PlaneGrid grid{fine_, centre, most + float(texel)};
  const bool finer = grid.texel() < 0.5 * shadow.inner().texel();
  if (finer && reach(grid.extent) < kUnfaded * shadow.outer().extent) return grid;
  return {fine_, centre, 0};
}

// Draws what is stale in both sets.
void MeshShadowLight::draw(const MeshShadow& shadow) {
  Set* const sets[] = {&now_, before_ ? &*before_ : nullptr};
  std::vector<int> stale[2];
  bool due = false;
  for (int i = 0; i < 2; ++i) {
    if (!sets[i]) continue;
    stale[i] = stale_directions(*sets[i], shadow);
    due = due || !sets[i]->drawn || !stale[i].empty();
    sets[i]->drawn = true;
  }
  if (!due) return;
  // Drawn where the object is turned, not where it is shifted: grid and object shift together.
  const PlaneMotion turn = motion_.turn();
  PlaneGrid inner = shadow.inner(), outer = shadow.outer();
  inner.centre = outer.centre = turn * inner.centre;
  ShadowTriangles moved, moved_outer;
  const auto placed = [&](const ShadowTriangles& own, ShadowTriangles& other) {
    if (turn.turned()) other = own.moved(turn);
    return turn.turned() ? &other : &own;
  };
  const ShadowTriangles& triangles = *placed(shadow.triangles(), moved);
  const bool same = &shadow.outer_triangles() == &shadow.triangles();
  const ShadowTriangles& outer_triangles =
      same ? triangles : *placed(shadow.outer_triangles(), moved_outer);
  fine_map_ = fine_grid(shadow, triangles);
  for (int i = 0; i < 2; ++i) {
    if (!sets[i]) continue;
    Set& set = *sets[i];
    const std::size_t count = set.split.directions().size();
    set.inner_parts.resize(count), set.outer_parts.resize(count), set.drawn_from.resize(count);
    for (const int k : stale[i]) set.drawn_from[std::size_t(k)] = projection(set, std::size_t(k));
    if (!stale[i].empty()) {
      draw_directions(triangles, set, stale[i], inner, set.inner_parts);
      draw_directions(outer_triangles, set, stale[i], outer, set.outer_parts);
      set.inner = SparseCover(inner.size, set.inner_parts);
      set.outer = SparseCover(outer.size, set.outer_parts);
    }
    set.fine = SparseCover();
    if (!(fine_map_.extent > 0)) continue;
    std::vector<SparseCover::Source> parts(count), fine;
    draw_directions(triangles, set, set.compact, fine_map_, parts);
    for (const int k : set.compact) fine.push_back(std::move(parts[std::size_t(k)]));
    set.fine = SparseCover(fine_map_.size, fine);
  }
}

// Weights of a cover's directions: those of one near light or, for −1, of distant light. For the
// fine map's cover, which holds the compact ones alone, only these.
std::vector<glm::vec4> MeshShadowLight::lights_of(const Set& set, Part part, int near_light) const {
  std::vector<glm::vec4> lights(set.lights.size(), glm::vec4(0));
  const std::vector<glm::vec3>& directions = set.split.directions();
  for (std::size_t k = 0; k < lights.size(); ++k)
    if (set.near_light[k] == near_light)
      lights[k] = set.lights[k] * (near_light < 0 ? 1 : near_.height(directions[k], near_light));
  if (part == Part::rest)
    for (const int k : set.compact) lights[std::size_t(k)] = glm::vec4(0);
  if (part != Part::compact) return lights;
  std::vector<glm::vec4> compact;
  for (const int k : set.compact) compact.push_back(lights[std::size_t(k)]);
  return compact;
}

// Adds the loss of distant light.
void MeshShadowLight::add_lights(Cover cover, Part part, std::vector<float>& lost) const {
  for (const Set* set : {&now_, before_ ? &*before_ : nullptr})
    if (set && (part != Part::compact || !set->compact.empty()))
      (set->*cover).add(lights_of(*set, part, -1), lost);
}

// Adds the loss of near lights. grid: of the image, in the marker frame.
void MeshShadowLight::add_near(Cover cover, Part part, const PlaneGrid& grid,
                               Image<float>& lost) const {
  for (int i = 0; i < near_.count(); ++i) {
    std::vector<float> own = no_loss(grid.size);
    for (const Set* set : {&now_, before_ ? &*before_ : nullptr})
      if (set && (part != Part::compact || !set->compact.empty()))
        (set->*cover).add(lights_of(*set, part, i), own);
    const Image<float> image = unblocked(own, grid.size);
    for_rows(grid, [&](int y, const std::vector<glm::vec2>& points) {
      std::vector<float> falloff(points.size());
      near_.falloff(i, points, falloff);
      const float* from = image.row(y);
      float* to = lost.row(y);
      for (std::size_t x = 0; x < points.size(); ++x)
        for (std::size_t c = 0; c < 3; ++c) to[3 * x + c] += falloff[x] * from[3 * x + c];
    });
  }
}

// Turns lost light, as a share of that at the map's centre, into a share of each place's own light.
void MeshShadowLight::divide_by_light(const PlaneGrid& grid, Image<float>& lost) const {
  if (near_.count() == 0) return;
  for_rows(grid, [&](int y, const std::vector<glm::vec2>& points) {
    std::vector<float> falloff(points.size());
    std::vector<glm::vec3> light(points.size(), glm::vec3(1));
    for (int i = 0; i < near_.count(); ++i) {
      near_.falloff(i, points, falloff);
      const glm::vec3 share = near_shares_[std::size_t(i)],
                      plane_share = near_plane_shares_[std::size_t(i)];
      for (std::size_t x = 0; x < points.size(); ++x) light[x] += falloff[x] * plane_share - share;
    }
    float* row = lost.row(y);
    for (std::size_t x = 0; x < points.size(); ++x)
      for (int c = 0; c < 3; ++c) row[3 * x + std::size_t(c)] /= std::max(light[x][c], 1e-6f);
  });
}

// Makes the fine map from what all other light leaves, between the texels of its maps, and what the
// compact lights leave at the fine map's own.
void MeshShadowLight::add_fine(const ShadowMap& rest, ShadowMap& map) const {
  const int n = fine_map_.size;
  std::vector<float> lost = no_loss(n);
  add_lights(&Set::fine, Part::compact, lost);
  map.fine = unblocked(lost, n);
  map.fine_centre = fine_map_.centre + motion_.shift, map.fine_extent = fine_map_.extent;
  const PlaneGrid grid{n, map.fine_centre, map.fine_extent};
  add_near(&Set::fine, Part::compact, grid, map.fine);
  divide_by_light(grid, map.fine);
  const ShadowLookUp look_up(rest);
  for_rows(grid, [&](int y, const std::vector<glm::vec2>& points) {
    std::vector<glm::vec3> ratios(points.size());
    look_up.sample(points, ratios);
    float* row = map.fine.row(y);
    for (int i = 0; i < 3 * n; ++i) {
      const float left = (&ratios[0].x)[i] - row[i];
      row[i] = left < 2 * kNothing ? 0 : left;  // the look-up errs by as much again
    }
  });
}

std::vector<glm::vec4> MeshShadowLight::share_out(const MeshShadow& shadow, bool& no_light) {
  std::vector<glm::vec4> cells(std::size_t(shadow.cells().count()), glm::vec4(0));
  const auto add = [&](Set& set, float part) {
    std::vector<glm::vec4> own = sums_.sum(set.weights.rest);
    glm::dvec3 total(0);
    for (const glm::vec4& w : set.weights.directions) total += glm::dvec3(w);
    for (const glm::vec4& w : own) total += glm::dvec3(w);
    glm::vec4 scale(0);
    for (int k = 0; k < 3; ++k) {
      if (!(total[k] > kLeastLight)) total[k] = 0;
      scale[k] = total[k] > 0 ? float(part / total[k]) : 0;
    }
    set.lights = set.weights.directions;
    for (glm::vec4& w : set.lights) w *= scale;
    for (std::size_t i = 0; i < own.size(); ++i) cells[i] += own[i] * scale;
    no_light = total == glm::dvec3(0);
  };
  if (before_) add(*before_, 1 - fade_);
  add(now_, before_ ? fade_ : 1);
  near_shares_.assign(std::size_t(near_.count()), glm::vec3(0)), near_plane_shares_ = near_shares_;
  for (const Set* set : {&now_, before_ ? &*before_ : nullptr})
    for (std::size_t k = 0; set && k < set->lights.size(); ++k) {
      const int i = set->near_light[k];
      if (i < 0) continue;
      const glm::vec3 share(set->lights[k]);
      near_shares_[std::size_t(i)] += share;
      near_plane_shares_[std::size_t(i)] += share * near_.height(set->split.directions()[k], i);
    }
  return cells;
}

ShadowMap MeshShadowLight::cast(const MeshShadow& shadow, const CubeMap& radiance,
                                const Pose& marker_from_object, const NearLights& near_lights) {
  const std::optional<PlaneMotion> motion = shadow.motion(marker_from_object);
  check(motion.has_value(),
        "expected an object that stands as its shadow was baked, got one tilted",
        " or lifted off the plane");
  check(radiance.size() > 0, "the radiance map is empty");
  if (shadow_ != shadow.number())
    *this = MeshShadowLight(options_, fine_), shadow_ = shadow.number();
  update(radiance);
  place_lights(near_lights, *motion);
  draw(shadow);
  const float turn = std::atan2(motion_.cos_sin.y, motion_.cos_sin.x);
  if (sums_.size() != now_.weights.rest_size || sums_.turn() != turn)
    sums_ = CellSums(shadow.cells(), now_.weights.rest_size, turn);

  ShadowMap map;
  map.centre = motion_ * shadow.inner().centre;
  map.extent = shadow.inner().extent, map.outer_extent = shadow.outer().extent;
  const std::vector<glm::vec4> cells = share_out(shadow, map.no_light);
  const PlaneGrid inner{shadow.inner().size, map.centre, map.extent},
      outer{shadow.outer().size, map.centre, map.outer_extent};
  ShadowMap soft;  // what the cells leave, where the object is turned
  const bool fine = fine_map_.extent > 0;
  ShadowMap rest;  // without the compact lights that the fine map shows
  const auto make = [&](const SparseCover& table, Cover cover, const PlaneGrid& grid,
                        Image<float>& own, Image<float>& of_rest) {
    std::vector<float> lost = no_loss(table.size());
    table.add(cells, lost);
    if (motion_.turned()) {
      own = unblocked(lost, table.size());
      to_ratio(own);
      std::fill(lost.begin(), lost.end(), 0.0f);
    }
    if (fine) {
      std::vector<float> of_others = lost;
      add_lights(cover, Part::rest, of_others);
      of_rest = unblocked(of_others, table.size());
      add_near(cover, Part::rest, grid, of_rest);
    }
    add_lights(cover, Part::all, lost);
    Image<float> image = unblocked(lost, table.size());
    add_near(cover, Part::all, grid, image);
    return image;
  };
  map.ratio = make(shadow.tables().inner, &Set::inner, inner, soft.ratio, rest.ratio);
  map.outer = make(shadow.tables().outer, &Set::outer, outer, soft.outer, rest.outer);
  soft.extent = map.extent, soft.outer_extent = map.outer_extent;
  const ShadowLookUp own(soft);
  const auto finish = [&](ShadowMap& whole) {
    if (motion_.turned()) {
      add_turned(own, shadow.inner().extent, motion_.turn(), whole.ratio);
      add_turned(own, shadow.outer().extent, motion_.turn(), whole.outer);
    }
    divide_by_light(inner, whole.ratio), divide_by_light(outer, whole.outer);
    to_ratio(whole.ratio), to_ratio(whole.outer);
    fade_border(whole.outer);
  };
  finish(map);
  if (fine && !map.no_light) {
    rest.centre = map.centre, rest.extent = map.extent, rest.outer_extent = map.outer_extent;
    finish(rest);
    add_fine(rest, map);
  }
  return map;
}

}  // namespace fastibl
