#include "fastibl/shadow/sky_split.h"

#include <algorithm>
#include <cmath>
#include <queue>

namespace fastibl {
namespace {

constexpr int kSearchSize = 128;   // texels along a face of the level that is searched for lights
constexpr int kRestSize = 32;      // and of the level that the cells are summed from
constexpr int kMostCuts = 5;       // a texel is cut into at most 4⁵ pieces
constexpr double kHorizon = 1e-3;  // z below which light hardly reaches the plane

struct Texel {
  glm::dvec3 direction;  // unit length
  double cosine;         // × solid angle
};

// A piece of a texel. It counts above the horizon; where the horizon cuts it, its centre decides.
Texel texel_of(int face, double x, double y, double edge, int size) {
  const glm::dvec3 d(
      face_direction(face, float((x + 0.5 * edge) / size), float((y + 0.5 * edge) / size)));
  const double length2 = glm::dot(d, d), z = d.z / std::sqrt(length2);
  // Solid angle of a small square of a face's plane at distance 1: area / length³.
  const double area = 4 * edge * edge / (double(size) * size);
  return {d / std::sqrt(length2), z > kHorizon ? area * z / (length2 * std::sqrt(length2)) : 0};
}

int level_of_size(const CubeMap& map, int size) {
  int k = 0;
  while (k + 1 < map.level_count() && map.level(k).size() > size) ++k;
  return k;
}

}  // namespace

// A piece while the directions are looked for.
struct SkySplit::Element {
  Piece piece;
  glm::dvec3 direction;
  double energy;  // share of the irradiance, mean of the channels
};

// Texels above the threshold, cut while their own extent is too large.
void SkySplit::collect(const CubeMap& map, const glm::dvec3& scale, const SkySplitOptions& options,
                       std::vector<Element>& elements) const {
  const int first = level_of_size(map, kSearchSize), rest = level_of_size(map, kRestSize);
  const CubeLevel& level = map.level(first);
  const int n = level.size(), rest_size = map.level(rest).size();
  // Exact solid angles, by which the means of the levels are weighted: what is taken from a texel
  // of the rest is then what was there.
  std::vector<std::vector<double>> angles(std::size_t(map.level_count()));
  const auto solid_angle = [&](int at, int x, int y) {
    const int size = map.level(at).size();
    std::vector<double>& of_level = angles[std::size_t(at)];
    if (of_level.empty()) of_level = texel_solid_angles(size);
    return of_level[std::size_t(y) * size + x];
  };
  // Where a piece lies, its corner and edge in texels of level `at`.
  struct Square {
    int at;
    double x, y, edge;
    int cuts;
  };
  std::vector<Square> open;
  for (int face = 0; face < 5; ++face)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const glm::dvec3 radiance(level.texel(face, x, y));
        const double brightness = glm::dot(radiance, scale);
        if (!(brightness > options.threshold)) continue;
        const double part = 1 - options.threshold / brightness;
        open.push_back({first, double(x), double(y), 1, 0});
        while (!open.empty()) {
          const Square q = open.back();
          open.pop_back();
          const CubeLevel& here = map.level(q.at);
          const int tx = int(q.x), ty = int(q.y), size = here.size();
          const Texel texel = texel_of(face, q.x, q.y, q.edge, size);
          const double energy = part * texel.cosine *
                                glm::dot(glm::dvec3(here.texel(face, tx, ty)), scale) /
                                std::numbers::pi;
          const double radius =
              q.edge * 0.8 / size;  // √(2/12) of the edge, an edge is up to 2/size
          const bool cut = energy * std::sqrt(radius) > options.tolerance && q.cuts < kMostCuts;
          if (cut) {
            const bool finer = q.at > 0 && q.edge == 1 && map.level(q.at - 1).size() == 2 * size;
            for (int k = 0; k < 4; ++k)
              open.push_back(
                  finer ? Square{q.at - 1, 2 * q.x + (k & 1), 2 * q.y + (k >> 1), 1, q.cuts + 1}
                        : Square{q.at, q.x + 0.5 * q.edge * (k & 1), q.y + 0.5 * q.edge * (k >> 1),
                                 0.5 * q.edge, q.cuts + 1});
            continue;
          }
          if (texel.cosine == 0) continue;
          const double middle_x = (q.x + 0.5 * q.edge) / size,
                       middle_y = (q.y + 0.5 * q.edge) / size;
          const int rx = std::min(int(middle_x * rest_size), rest_size - 1),
                    ry = std::min(int(middle_y * rest_size), rest_size - 1);
          const double angle = q.edge * q.edge * solid_angle(q.at, tx, ty);
          elements.push_back(
              {{std::uint8_t(q.at), std::uint8_t(face), std::uint16_t(tx), std::uint16_t(ty), 0,
                std::int32_t((face * rest_size + ry) * rest_size + rx),
                float(part * angle * texel.direction.z),
                float(part * angle / solid_angle(rest, rx, ry))},
               texel.direction,
               energy});
        }
      }
}

// Halves groups of pieces, the one that would leave the largest error first.
void SkySplit::group(const SkySplitOptions& options, std::vector<Element>& elements) {
  struct Group {
    double error;
    int begin, end;
    glm::dvec3 axis;  // along which it is widest
    bool operator<(const Group& other) const {
      return error != other.error ? error < other.error : begin > other.begin;
    }
  };
  const auto measured = [&](int begin, int end) {
    double energy = 0;
    glm::dvec3 mean(0);
    for (int i = begin; i < end; ++i) {
      const Element& e = elements[std::size_t(i)];
      energy += e.energy, mean += e.energy * e.direction;
    }
    mean /= energy;
    glm::dmat3 spread(0);
    for (int i = begin; i < end; ++i) {
      const Element& e = elements[std::size_t(i)];
      const glm::dvec3 d = e.direction - mean;
      spread += e.energy * glm::outerProduct(d, d);
    }
    const double radius =
        std::sqrt(std::max(spread[0][0] + spread[1][1] + spread[2][2], 0.0) / energy);
    // Power iteration, from the longest column, which has most of the widest axis.
    glm::dvec3 axis = spread[0];
    for (int k = 1; k < 3; ++k)
      if (glm::dot(spread[k], spread[k]) > glm::dot(axis, axis)) axis = spread[k];
    for (int k = 0; k < 8; ++k) {
      const double length = glm::length(axis);
      if (!(length > 0)) break;
      axis = spread * (axis / length);
    }
    return Group{end - begin > 1 ? energy * std::sqrt(radius) : 0, begin, end, axis};
  };
  std::priority_queue<Group> groups;
  groups.push(measured(0, int(elements.size())));
  while (int(groups.size()) < options.most_directions && groups.top().error > options.tolerance) {
    const Group g = groups.top();
    groups.pop();
    const auto from = elements.begin() + g.begin, to = elements.begin() + g.end;
    std::stable_sort(from, to, [&](const Element& a, const Element& b) {
      return glm::dot(a.direction, g.axis) < glm::dot(b.direction, g.axis);
    });
    double half = 0, sum = 0;
    for (auto e = from; e != to; ++e) half += 0.5 * e->energy;
    int middle = g.begin;
    while (middle < g.end - 1 && sum + 0.5 * elements[std::size_t(middle)].energy < half)
      sum += elements[std::size_t(middle++)].energy;
    middle = std::max(middle, g.begin + 1);
    groups.push(measured(g.begin, middle));
    groups.push(measured(middle, g.end));
  }
  for (; !groups.empty(); groups.pop()) {
    glm::dvec3 mean(0);
    double share = 0;
    for (int i = groups.top().begin; i < groups.top().end; ++i) {
      Element& e = elements[std::size_t(i)];
      mean += e.energy * e.direction, share += e.energy;
      e.piece.direction = std::uint16_t(directions_.size());
    }
    directions_.push_back(glm::vec3(glm::normalize(mean)));
    shares_.push_back(float(share));
  }
}

namespace {

// Cosine × solid angle of all texels of a level, 0 below the horizon.
std::vector<float> cosines_of(int n) {
  std::vector<float> cosines(std::size_t(6) * n * n, 0.0f);
  for (int i = 0; i < 5 * n * n; ++i)
    cosines[std::size_t(i)] = float(texel_of(i / (n * n), i % n, i / n % n, 1, n).cosine);
  return cosines;
}

std::vector<glm::vec3> packed(const CubeLevel& level) {
  const int n = level.size();
  std::vector<glm::vec3> out;
  out.reserve(std::size_t(6) * n * n);
  for (int face = 0; face < 6; ++face)
    for (int y = 0; y < n; ++y) {
      const glm::vec3* row = level.face(face) + y * level.row_stride();
      out.insert(out.end(), row, row + n);
    }
  return out;
}

glm::dvec3 irradiance_of(std::span<const glm::vec3> radiance, std::span<const float> cosines) {
  glm::dvec3 irradiance(0);
  for (std::size_t i = 0; i < cosines.size(); ++i)
    if (cosines[i] > 0) irradiance += glm::dvec3(radiance[i] * cosines[i]);
  return irradiance;
}

// Its dot product with a texel's radiance is the texel's brightness: the mean of the channels that
// have light, which is 1 for a texel as bright as the cosine-weighted mean.
glm::vec3 brightness_scale(const glm::dvec3& irradiance) {
  int lit = 0;
  for (int c = 0; c < 3; ++c) lit += irradiance[c] > 0;
  glm::vec3 scale(0);
  for (int c = 0; c < 3; ++c)
    if (irradiance[c] > 0) scale[c] = float(std::numbers::pi / (irradiance[c] * lit));
  return scale;
}

// Share of the irradiance that lies above this brightness.
float share_above(std::span<const glm::vec3> radiance, std::span<const float> cosines,
                  const glm::vec3& scale, float threshold) {
  float sum = 0;
  for (std::size_t i = 0; i < cosines.size(); ++i)
    sum += std::max(glm::dot(radiance[i], scale) - threshold, 0.0f) * cosines[i];
  return sum / kPi;
}

}  // namespace

SkySplit::SkySplit(const CubeMap& map, const SkySplitOptions& options)
    : size_(map.size()), threshold_(options.threshold) {
  const CubeLevel& rest = map.level(level_of_size(map, kRestSize));
  rest_cosines_ = cosines_of(rest.size());
  const glm::vec3 scale = brightness_scale(irradiance_of(packed(rest), rest_cosines_));
  std::vector<Element> elements;
  collect(map, glm::dvec3(scale), options, elements);
  double share = 0;
  for (const Element& e : elements) share += e.energy;
  if (share > options.least_share && options.most_directions > 0) {
    group(options, elements);
    for (const Element& e : elements) pieces_.push_back(e.piece);
  }
  const Weights weights = weigh(map);
  bright_ = share_above(weights.rest, rest_cosines_, scale, 2 * threshold_);
}

SkySplit::Weights SkySplit::weigh(const CubeMap& map) const {
  Weights out;
  const CubeLevel& rest = map.level(level_of_size(map, kRestSize));
  out.rest = packed(rest), out.rest_size = rest.size();
  out.irradiance = irradiance_of(out.rest, rest_cosines_);
  out.directions.assign(directions_.size(), glm::vec4(0));
  for (const Piece& p : pieces_) {
    const CubeLevel& level = map.level(p.level);
    const glm::vec3 radiance = level.texel(p.face, p.x, p.y);
    out.directions[p.direction] += glm::vec4(radiance * p.flux, 0);
    out.rest[std::size_t(p.rest)] -= radiance * p.taken;
  }
  return out;
}

float SkySplit::misfit(const Weights& weights) const {
  const glm::vec3 scale = brightness_scale(weights.irradiance);
  constexpr float kGrown = 4, kLeast = 0.02f;
  float share =
      std::max(share_above(weights.rest, rest_cosines_, scale, 2 * threshold_) - bright_, 0.0f);
  for (std::size_t k = 0; k < shares_.size(); ++k) {
    const float now = glm::dot(glm::vec3(weights.directions[k]), scale) / kPi;
    if (now > kGrown * shares_[k]) share += now - shares_[k];
  }
  return share > kLeast ? share : 0;
}

std::vector<int> SkySplit::compact(float least_share) const {
  std::vector<int> found;
  if (shares_.empty()) return found;
  // The strongest direction, with what lies around it: a sun's disc may be many directions.
  const float least_cosine = std::cos(kCompact);
  const auto around = [&](std::size_t k, std::size_t i) {
    return glm::dot(directions_[k], directions_[i]) >= least_cosine;
  };
  float most = 0;
  std::size_t strongest = 0;
  for (std::size_t k = 0; k < shares_.size(); ++k) {
    float sum = 0;
    for (std::size_t i = 0; i < shares_.size(); ++i) sum += around(k, i) ? shares_[i] : 0;
    if (sum > most) most = sum, strongest = k;
  }
  for (std::size_t i = 0; most >= least_share && i < shares_.size(); ++i)
    if (around(strongest, i)) found.push_back(int(i));
  return found;
}

float SkySplit::moved(const Weights& before, const Weights& after) const {
  // By shares, so that light that changes as a whole does not count as moved.
  glm::vec3 scale[2];
  const Weights* weights[2] = {&before, &after};
  for (int k = 0; k < 2; ++k) scale[k] = brightness_scale(weights[k]->irradiance) / kPi;
  float sum = 0;
  for (std::size_t i = 0; i < after.directions.size(); ++i)
    sum += std::fabs(glm::dot(glm::vec3(after.directions[i]), scale[1]) -
                     glm::dot(glm::vec3(before.directions[i]), scale[0]));
  for (std::size_t i = 0; i < after.rest.size(); ++i)
    sum += std::fabs(glm::dot(after.rest[i], scale[1]) - glm::dot(before.rest[i], scale[0])) *
           rest_cosines_[i];
  return 0.5f * sum;
}

CellSums::CellSums(const SkyCells& cells, int size, float turn)
    : size_(size), cells_(cells.count()), turn_(turn) {
  // Pieces of texels, so that cells get their parts of those that lie across their edges.
  const int parts = std::max(128 / size, 1);
  const double edge = 1.0 / parts;
  std::vector<Entry> of_texel;
  for (int face = 0; face < 5; ++face)
    for (int y = 0; y < size; ++y)
      for (int x = 0; x < size; ++x) {
        of_texel.clear();
        for (int k = 0; k < parts * parts; ++k) {
          const Texel t =
              texel_of(face, x + edge * (k % parts), y + edge * (k / parts), edge, size);
          if (t.cosine == 0) continue;
          const float polar = std::acos(std::min(float(t.direction.z), 1.0f));
          const float azimuth = std::atan2(float(t.direction.y), float(t.direction.x)) - turn;
          const int cell = cells.cell(polar, azimuth / (2 * kPi));
          auto found = std::find_if(of_texel.begin(), of_texel.end(),
                                    [&](const Entry& e) { return e.cell == cell; });
          if (found == of_texel.end())
            found = of_texel.insert(found, {(face * size + y) * size + x, cell, 0});
          found->cosine += float(t.cosine);
        }
        entries_.insert(entries_.end(), of_texel.begin(), of_texel.end());
      }
}

std::vector<glm::vec4> CellSums::sum(std::span<const glm::vec3> rest) const {
  std::vector<glm::vec4> sums(std::size_t(cells_), glm::vec4(0));
  for (const Entry& e : entries_)
    sums[std::size_t(e.cell)] += glm::vec4(rest[std::size_t(e.texel)] * e.cosine, 0);
  // Rounding can leave a texel that lost all its light with less than nothing.
  for (glm::vec4& s : sums) s = glm::max(s, glm::vec4(0));
  return sums;
}

}  // namespace fastibl
