#include "fastibl/capture/picture_taker.h"

#include <algorithm>
#include <cstddef>
#include <span>

#include "fastibl/capture/footprint.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/prefetch.h"

namespace fastibl {
namespace {

constexpr double kFarther = 2, kFartherBy = 0.3;  // factor, metres: beyond, wide pictures tell less

}  // namespace

PictureTaker::PictureTaker(const PosedPicture& posed, const Taking& how, const PlaceLayout& place,
                           MapTiles& map, TileViews& views, FrameLevels& levels)
    : posed_(posed),
      how_(how),
      place_(place),
      map_(map),
      views_(views),
      levels_(levels),
      bands_(posed, place.viewpoint(), map.grid().size),
      reader_(posed, how.taken, how.bright, place.surroundings(), levels) {}

bool PictureTaker::take(std::vector<int>& changed) {
  const float most = find_tiles();
  if (tiles_.empty()) return false;
  bands_.place(tiles_, map_.geometry, place_.surroundings());
  const Picture& picture = posed_.picture;
  // Probes are four times as large as texels.
  levels_.make(picture, posed_.side.camera.response, levels_for(4 * most));
  posed_.side.noise.listen(posed_.pixels(), picture.width, picture.height);
  leave_out_quiet_tiles();
  std::vector<std::uint8_t> is_changed(tiles_.size(), 0);
  parallel_for(int(tiles_.size()), 8, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      if (i + 1 < end) map_.prefetch(tiles_[std::size_t(i) + 1]);
      is_changed[std::size_t(i)] = add_tile(tiles_[std::size_t(i)]);
    }
  });
  const glm::dvec3 eye = posed_.eye();
  for (std::size_t i = 0; i < tiles_.size(); ++i)
    if (is_changed[i]) {
      const int tile = tiles_[i];
      changed.push_back(tile);
      views_.eyes[std::size_t(tile)] = eye;
      if (how_.plane && !map_.above(tile)) views_.plane_seen[std::size_t(tile)] = 1;
    }
  return true;
}

float PictureTaker::find_tiles() {
  float most = 0;
  bands_.find_tiles(map_.geometry.outlines, most_pixels_);
  tiles_.reserve(std::size_t(map_.grid().count()));
  for (int tile = 0; tile < map_.grid().count(); ++tile)
    if (most_pixels_[std::size_t(tile)] > 0) {
      tiles_.push_back(tile);
      most = std::max(most, most_pixels_[std::size_t(tile)]);
    }
  if (!how_.plane)
    std::erase_if(tiles_, [&](int tile) {
      return views_.plane_seen[std::size_t(tile)] != 0 && map_.was_seen_whole(tile);
    });
  if (posed_.side.of_wide) leave_out_far_tiles();
  return most;
}

// Near things are seen in other directions from far off: pictures of a 360° camera that is carried
// through a room only fill in what those beside the object did not see. A light whose place is
// known is not left out.
void PictureTaker::leave_out_far_tiles() {
  const double distance = glm::length(posed_.eye() - place_.centre());
  std::erase_if(tiles_, [&](int tile) {
    const double nearer = glm::length(views_.eyes[std::size_t(tile)] - place_.centre());
    return map_.above(tile) && map_.was_seen_whole(tile) && is_usual(tile) &&
           distance > kFarther * nearer + kFartherBy;
  });
}

bool PictureTaker::is_usual(int tile) const {
  const Surroundings& surroundings = place_.surroundings();
  return surroundings.is_usual(surroundings.depth(tile));
}

void PictureTaker::leave_out_quiet_tiles() {
  const std::vector<std::vector<int>> groups = quiet_groups();
  constexpr std::size_t kTiles = kTexelLanes / QuietTiles::kProbes;
  std::vector<std::span<const int>> parts;
  for (const std::span<const int> group : groups)
    for (std::size_t i = 0; i < group.size(); i += kTiles)
      parts.push_back(group.subspan(i, std::min(kTiles, group.size() - i)));
  if (parts.empty()) return;
  left_out_.assign(std::size_t(map_.grid().count()), 0);
  parallel_for(int(parts.size()), 2, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) compare_probes(parts[std::size_t(i)]);
  });
  std::erase_if(tiles_, [&](int tile) { return left_out_[std::size_t(tile)] != 0; });
}

std::vector<std::vector<int>> PictureTaker::quiet_groups() const {
  std::vector<std::vector<int>> groups(std::size_t(12 * bands_.count()));
  for (const int tile : tiles_)
    if (map_.was_seen_whole(tile) && map_.quiet.may_leave_out(tile, how_.time) && is_usual(tile)) {
      const int group = 2 * (tile / map_.grid().per_face()) + map_.above(tile);
      groups[std::size_t(12 * bands_.band(tile) + group)].push_back(tile);
      prefetch_items(map_.quiet.value(tile, 0), 6 * QuietTiles::kProbes);
    }
  return groups;
}

void PictureTaker::compare_probes(std::span<const int> tiles) {
  const int count = int(tiles.size());
  constexpr int kProbes = QuietTiles::kProbes;
  const int lanes = count * kProbes, face = tiles[0] / map_.grid().per_face(),
            half = map_.grid().size / 2;
  alignas(64) float columns[kTexelLanes], rows[kTexelLanes], values[3][kTexelLanes],
      rough[3][kTexelLanes];
  for (int t = 0; t < count; ++t) {
    const FaceRect r = tile_rect(map_.grid(), tiles[t]);
    QuietTiles::Place probes[kProbes];
    map_.quiet.places(tiles[t], probes);
    for (int p = 0; p < kProbes; ++p) {
      columns[t * kProbes + p] = float(r.x0 / 2 + probes[p].x);
      rows[t * kProbes + p] = float(r.y0 / 2 + probes[p].y);
    }
    for (int c = 0; c < 3; ++c) {
      std::copy_n(map_.quiet.value(tiles[t], c), kProbes, &values[c][t * kProbes]);
      std::copy_n(map_.quiet.rough(tiles[t], c), kProbes, &rough[c][t * kProbes]);
    }
  }
  const float first = 1.0f / float(half) - 1;
  const TexelGroup group{face,
                         first,
                         first,
                         2.0f / float(half),
                         columns,
                         rows,
                         lanes,
                         lanes,
                         place_.surroundings().depth(tiles[0])};
  Sightings sightings;
  if (!bands_.halved(tiles[0]).see(group, map_.above(tiles[0]), sightings)) return;
  for (int t = 0; t < count; ++t) bands_.unroll(tiles[t], t * kProbes, kProbes, sightings);
  Samples samples;
  reader_.read(group.depth, lanes, false, sightings, samples);
  alignas(64) float deviance[kTexelLanes];
  const float* const value[3] = {values[0], values[1], values[2]};
  const float* const variance[3] = {rough[0], rough[1], rough[2]};
  compare_samples(value, variance, lanes, sightings, samples, posed_.side.noise, deviance);
  for (int t = 0; t < count; ++t) {
    const int tile = tiles[t], at = t * kProbes;
    left_out_[std::size_t(tile)] = map_.quiet.leave_out(
        tile, sighting(tile, sightings, samples, at, kProbes), &sightings.seen[at], &deviance[at]);
  }
}

TileSighting PictureTaker::sighting(int tile, const Sightings& sightings, const Samples& samples,
                                    int first, int count) const {
  TileSighting s{how_.time, reader_.scale(), reader_.scale(), most_pixels_[std::size_t(tile)]};
  if (posed_.side.vignettes())
    for (int i = first; i < first + count; ++i)
      if (sightings.seen[i]) {
        s.least_scale = std::min(s.least_scale, samples.radiance_per_linear[i]);
        s.most_scale = std::max(s.most_scale, samples.radiance_per_linear[i]);
      }
  return s;
}

bool PictureTaker::leave_out_seen(int tile, int first, int count, Sightings& sightings) const {
  int left = 0;
  for (int i = 0; i < count; ++i) {
    sightings.seen[i] &= map_.state.last_seen.at(tile, first + i) == kNever;
    left += sightings.seen[i];
  }
  return left > 0;
}

bool PictureTaker::add_tile(int tile) {
  const int all = map_.geometry.texels(tile);
  const std::size_t start = map_.geometry.start(tile);
  Sightings sightings;
  Samples samples;
  samples.shortest = how_.shortest;
  const TexelView& texels = bands_.texels(tile);
  const bool keep_seen = !how_.plane && views_.plane_seen[std::size_t(tile)];
  bool any = false, whole = true, rim = false;
  float unsure[QuietTiles::kProbes];
  std::fill_n(unsure, QuietTiles::kProbes, -1.0f);
  TileSighting shown{};
  for (int k = 0; k < all; k += kTexelLanes) {
    const int count = std::min(kTexelLanes, all - k);
    const TexelGroup group = map_.geometry.group(tile, k, count, place_.surroundings().depth(tile));
    if (!texels.see(group, sightings) ||
        (keep_seen && !leave_out_seen(tile, k, count, sightings))) {
      whole = false;
      continue;
    }
    bands_.unroll(tile, 0, count, sightings);
    rim |=
        reader_.read(group.depth, count, views_.at_rim[std::size_t(tile)] != 0, sightings, samples);
    const auto hidden = std::count(sightings.seen, sightings.seen + count, 0);
    whole &= hidden == 0;
    if (hidden == count) continue;
    const TileSighting part = sighting(tile, sightings, samples, 0, count);
    shown = any ? joined(shown, part) : part;
    any = true;
    alignas(64) float left[kTexelLanes];
    // Single texels need times of their own where not all are seen, or not all at once.
    const bool once = count == all && whole && map_.state.last_seen.same(tile);
    merge_samples(map_.state, start + std::size_t(k), count, sightings, samples, posed_.side.noise,
                  how_.time, once ? nullptr : map_.state.last_seen.texels(tile) + k,
                  map_.state.last_seen.at(tile, 0), left);
    map_.quiet.add_blocks(k, count, left, unsure);
  }
  if (!any) return false;
  if (reader_.shows_lights()) views_.at_rim[std::size_t(tile)] = rim;
  if (whole) map_.state.last_seen.set(tile, how_.time);
  relate_variances(map_.state, start, all);
  map_.sum(tile);
  const TileSums& sums = map_.sums[std::size_t(tile)];
  map_.quiet.took(tile, shown, unsure, whole, sums.bound_angle > 0);
  if (sums.count == all) map_.make_levels(tile);
  return true;
}

}  // namespace fastibl
