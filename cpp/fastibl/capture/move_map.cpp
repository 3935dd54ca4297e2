// Moves what a map holds to where it belongs: after the marker was turned under it, and once the
// distance of things is known.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "fastibl/capture/capture.h"
#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"

namespace fastibl {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFarAway = 1e9;  // metres
constexpr int kRounds = 3;

}  // namespace

// Every texel above the horizon takes what `old` held in source(tile, direction), std::nullopt for
// nothing.
template <class Source>
void Capture::resample(const TexelState& old, const Source& source) {
  const std::size_t stride = std::size_t(map_.grid().stride());
  const float half = 0.4f / float(map_.grid().size);
  // Averages those of the four texels around a texel's place that were seen, as if looked up there.
  const auto take = [&](int tile, int k, const std::optional<glm::vec3>& direction) {
    float count = 0, value[3] = {}, variance[3] = {};
    double seen = kNever;
    std::uint8_t bound = 0;
    for (int corner = 0; direction && corner < 4; ++corner) {
      const glm::vec3 side = glm::normalize(glm::cross(
          *direction, std::abs(direction->z) < 0.9f ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0)));
      const glm::vec3 other = glm::cross(*direction, side);
      const glm::vec3 d = *direction + half * ((corner & 1 ? 1.0f : -1.0f) * side +
                                               (corner & 2 ? 1.0f : -1.0f) * other);
      if (!(d.z > 0)) continue;  // the plane
      const TexelPlace at = texel_at(d, map_.grid().size);
      const TilePlace from = tile_place(map_.grid(), at.face, at.x, at.y);
      const double time = old.last_seen.at(from.tile, from.texel);
      if (!(time > kNever)) continue;
      const std::size_t i = std::size_t(from.tile) * stride + std::size_t(from.texel);
      for (int c = 0; c < 3; ++c) value[c] += old.value[c][i], variance[c] += old.variance[c][i];
      bound |= old.bound[i], seen = std::max(seen, time), ++count;
    }
    if (count == 0 && !(map_.state.last_seen.at(tile, k) > kNever)) return;
    const std::size_t to = std::size_t(tile) * stride + std::size_t(k);
    for (int c = 0; c < 3; ++c) {
      map_.state.value[c][to] = count > 0 ? value[c] / count : 0;
      // Adds what may differ within a texel.
      const float blur = kModelNoise * map_.state.value[c][to];
      map_.state.variance[c][to] = count > 0 ? variance[c] / count + blur * blur : 0;
    }
    map_.state.bound[to] = bound;
    map_.state.last_seen.texels(tile)[k] = seen;
  };
  parallel_for(map_.grid().count(), 32, [&](int begin, int end) {
    for (int tile = begin; tile < end; ++tile) {
      if (!map_.above(tile)) continue;
      const FaceRect r = tile_rect(map_.grid(), tile);
      int k = 0;
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x, ++k) {
          const glm::vec3 d = glm::normalize(texel_direction(r.face, x, y, map_.grid().size));
          if (d.z > 0) take(tile, k, source(tile, d));
        }
    }
  });
}

void Capture::turn(const glm::dmat3& new_from_old) {
  check(is_rotation(new_from_old, 1e-3), "a map can only be turned by a rotation");
  const glm::mat3 old_from_new(glm::transpose(new_from_old));
  const TexelState old = std::exchange(map_.state, TexelState(map_.grid()));
  resample(old, [&](int, const glm::vec3& d) { return std::optional(old_from_new * d); });
  sweep_ = SphereSweep(options_.centre);
  tracks_ = LightTracks(options_.centre);
  std::optional<RoomBox> box = surface().box();
  if (box) box = turned(*box, new_from_old);
  surroundings_ = Surroundings(map_.geometry.outlines, {options_.centre, distance(), box});
  prior_.reset(), sky_.clear();  // it was given for the marker as it lay before
  plane_seen_.assign(plane_seen_.size(), 0), at_rim_.assign(at_rim_.size(), 0);
  eyes_.assign(eyes_.size(), glm::dvec3(kInfinity));
  scale_.mix();
  unseen_ = UnseenTiles(map_.grid(), float(options_.plane_albedo));
  renew_all();
}

void Capture::find_distance(const PosedPicture& posed) {
  if (options_.distance || options_.box || !sweep_.wants_more()) return;
  const CameraSide& side = posed.side;
  sweep_.add(
      posed.pixels(), side.camera, side.lens, posed.poses,
      [&](float x, float y) { return side.vignette(x, y); }, posed.mask);
  if (const auto better = sweep_.better_than(surface())) move_to(*better);
}

// What was recorded for another place was seen from a known one, so it can be recorded anew.
void Capture::move_to(const MapSurface& surface) {
  const Surroundings before =
      std::exchange(surroundings_, Surroundings(map_.geometry.outlines, MapSurface(surface)));
  surroundings_.place(map_.geometry.outlines, std::vector<LightPosition>(before.lights()));
  // For tiles that were not seen, the mean of where others were seen from: what belongs there was
  // recorded beside it.
  glm::dvec3 usual_eye(0);
  double seen = 0;
  for (std::size_t i = 0; i < eyes_.size(); ++i)
    if (map_.sums[i].count > 0) usual_eye += eyes_[i], ++seen;
  if (seen > 0) usual_eye /= seen;
  // Where a point was recorded depends on where its tile was seen from, and that on the tile.
  const auto recorded_in = [&](int tile, const glm::dvec3& direction) {
    const double nearness = std::max(surface.nearness(direction), 1 / kFarAway);
    const glm::dvec3 point = options_.centre + direction / nearness;
    glm::dvec3 there = direction;
    for (int round = 0; round < kRounds; ++round) {
      const std::size_t from =
          round == 0 ? std::size_t(tile) : std::size_t(map_.geometry.tile_in(there));
      const glm::dvec3& eye = map_.sums[from].count > 0 ? eyes_[from] : usual_eye;
      if (!std::isfinite(eye.x)) return direction;
      there = before.surface().recorded(eye, glm::normalize(point - eye));
    }
    return there;
  };
  const TexelState old = map_.state;
  resample(old, [&](int tile, const glm::vec3& d) -> std::optional<glm::vec3> {
    if (!before.is_usual(before.depth(tile))) return d;
    const glm::vec3 there(recorded_in(tile, glm::dvec3(d)));
    // What a light's tiles show was recorded where it is.
    return before.is_usual(before.depth(map_.geometry.tile_in(there))) ? std::optional(there)
                                                                       : std::nullopt;
  });
  std::vector<int> from(eyes_.size());
  std::iota(from.begin(), from.end(), 0);
  for (int tile = 0; tile < map_.grid().count(); ++tile)
    if (map_.above(tile))
      from[std::size_t(tile)] =
          map_.geometry.tile_in(recorded_in(tile, map_.geometry.outlines.middle(tile)));
  const std::vector<glm::dvec3> eyes = eyes_;
  for (std::size_t i = 0; i < from.size(); ++i) eyes_[i] = eyes[std::size_t(from[i])];
  scale_.move(from);
  at_rim_.assign(at_rim_.size(), 0);
  renew_all();
}

// Renews everything that is derived from the state.
void Capture::renew_all() {
  map_.renew();
  std::vector<int> all(std::size_t(map_.grid().count())), refilled;
  std::iota(all.begin(), all.end(), 0);
  new_sums_.clear();
  unseen_.update(all, map_.sums, map_.geometry.tile_projected, time_, true, refilled);
  for (const int tile : all)
    if (!refill(tile)) map_.make_levels(tile);
}

}  // namespace fastibl
