#include "fastibl/capture/capture.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fastibl/capture/expected_error.h"
#include "fastibl/capture/footprint.h"
#include "fastibl/capture/map_knowledge.h"
#include "fastibl/capture/move_map.h"
#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/prefetch.h"
#include "fastibl/scene/main_lights.h"

namespace fastibl {
namespace {

constexpr double kFarther = 2, kFartherBy = 0.3;  // factor, metres: beyond, wide pictures tell less
constexpr double kRimOfLight = 0.25;              // of a light's radiance: reached at its rim
constexpr double kLargestScale = 1e30;            // of linear values: no exposure is so short
// Bands of rows that share a pose: at 60 degrees a second and 30 ms of readout, neighbouring bands
// differ by 0.1 degrees.
constexpr int kBands = 16;
constexpr float kMostDrift = 0.5f;  // pictures a readout; nothing moves faster in a film

}  // namespace

struct Capture::View {
  const CameraSide& side;
  const std::vector<TexelView>& texels;  // by band of rows
  const std::vector<TexelView>& halved;  // the same for a map of half the size
  ImageView<const std::uint8_t> mask;
  double scale;      // radiance of a linear value after untint, without vignetting
  float light;       // linear value
  glm::vec3 untint;  // factors on linear values
  bool plane;        // whether the camera's place is known
};

Capture::Capture(CaptureOptions options)
    : options_(checked(std::move(options))),
      map_(TileGrid{options_.size}),
      place_(options_, map_.geometry.outlines),
      views_(map_.grid(), options_.centre),
      fills_(options_, map_),
      meter_(options_.board, options_.paper_albedo),
      scale_(map_.grid()) {}

Taken Capture::add(const Picture& picture, const Camera& camera, const Pose& camera_from_marker,
                   std::optional<double> exposure, double time, ImageView<const std::uint8_t> mask,
                   const std::optional<Pose>& last_row, const glm::dvec3& tint, bool plane,
                   int number) {
  check(picture.width == camera.width && picture.height == camera.height,
        "the picture must be the camera's ", camera.width, " × ", camera.height, ", got ",
        picture.width, " × ", picture.height);
  check_picture(picture);
  check_rows(mask, "the mask");
  check(mask.empty() ||
            (mask.width == camera.width && mask.height == camera.height && mask.channels == 1),
        "the mask must be the camera's ", camera.width, " × ", camera.height,
        " of one channel, got ", mask.width, " × ", mask.height, " of ", mask.channels);
  camera_from_marker.validate();
  if (last_row) last_row->validate();
  check(!exposure || (*exposure > 0 && std::isfinite(*exposure)),
        "an exposure must be positive and finite, got ", exposure.value_or(0));
  check(tint.x > 0 && tint.y > 0 && tint.z > 0 && std::isfinite(tint.x + tint.y + tint.z),
        "a tint must be positive and finite, got ", tint.x, " ", tint.y, " ", tint.z);
  check(std::isfinite(time) && time >= time_, "time must not run backwards: ", time, " s after ",
        time_, " s");
  KnownCamera& known = cameras_.get(camera, number, map_.grid().size);
  // Pictures without times of their own are stills, not a film.
  const bool still = time == time_ && last_camera_ == camera;
  const int refills = fills_.refills_after(time, still);
  time_ = time;
  if (last_camera_ != camera) last_camera_ = camera;
  const RowPoses poses(camera_from_marker, last_row);
  bright_ = MainLightOptions{}.brightness * fills_.mean_radiance(map_);
  Taken taken{.exposure = exposure.value_or(1)};
  ExposureDoubt& doubt = known.doubt;
  if (exposure) doubt.tell();
  if (!exposure || (options_.doubt_exposures && known.perspective())) {
    std::vector<LevelProbe> probes;
    known.each_side(picture, poses, mask,
                    [&](const PosedPicture& posed) { probe_level(posed, !exposure, probes); });
    for (LevelProbe& p : probes) p.expected *= glm::vec3(tint);
    taken = doubt.judge(probes, exposure, time);
    if (doubt.found_change()) distrust(*doubt.found_change());
    if (taken.as == TakenAs::left_out) return taken;
    if (taken.as == TakenAs::assumed) {
      taken.exposure = meter_.assumed_exposure(picture, camera).value_or(taken.exposure);
      doubt.assume(taken.exposure);
    }
  }
  taken.tint *= tint;
  std::vector<int> changed;
  bool any = false, metered = false;
  known.each_side(picture, poses, mask, [&](const PosedPicture& posed) {
    any |= take(posed, taken, plane, changed);
    metered = known.perspective() && plane && read_meter(posed, known, taken);
  });
  const bool assumed = doubt.assumed() && !known.metered;
  scale_.note(changed, assumed ? known.first : 0, !exposure);
  if (metered && !fills_.has_prior() && !map_.boost.any())
    scale_.mend(map_, *meter_.irradiance(), time_, changed);
  if (any) fills_.take(changed, refills, meter_.irradiance(), time_, map_);
  return taken;
}

bool Capture::take(const PosedPicture& posed, const Taken& taken, bool plane,
                   std::vector<int>& changed) {
  CameraSide& side = posed.side;
  const RowPoses& poses = posed.poses;
  const Camera& camera = side.camera;
  const double exposure = taken.exposure;
  const double tint = (taken.tint.x + taken.tint.y + taken.tint.z) / 3;  // of what is grey
  if (plane) learn_layout(posed, exposure * tint);
  hidden_ = discs_of(place_.surroundings().lights(), posed);
  const Viewpoint viewpoint = place_.viewpoint();
  std::vector<TexelView> texels, halved;
  const int bands = poses.rolling() ? kBands : 1;
  for (int band = 0; band < bands; ++band) {
    const Pose pose = poses.at(bands == 1 ? 0.0 : (band + 0.5) / bands);
    texels.emplace_back(camera, side.lens, side.bounds, pose, viewpoint, map_.grid().size);
    halved.emplace_back(camera, side.lens, side.bounds, pose, viewpoint, map_.grid().size / 2);
  }
  texels.front().find_tiles(map_.geometry.outlines, most_pixels_);
  if (poses.rolling()) {  // tiles that the picture shows at any time
    std::vector<float> most;
    for (const TexelView* view : {&texels[kBands / 2], &texels.back()}) {
      view->find_tiles(map_.geometry.outlines, most);
      for (std::size_t i = 0; i < most.size(); ++i)
        most_pixels_[i] = std::max(most_pixels_[i], most[i]);
    }
  }
  tiles_.clear();
  float most = 0;
  for (int tile = 0; tile < map_.grid().count(); ++tile)
    if (most_pixels_[std::size_t(tile)] > 0) {
      tiles_.push_back(tile);
      most = std::max(most, most_pixels_[std::size_t(tile)]);
    }
  if (!plane)
    std::erase_if(tiles_, [&](int tile) {
      return views_.plane_seen[std::size_t(tile)] != 0 && map_.was_seen_whole(tile);
    });
  const glm::dvec3 eye = posed.eye();
  if (side.of_wide) leave_out_far_tiles(eye);
  if (tiles_.empty()) return false;
  find_bands(texels, float(camera.height));
  // Probes are four times as large as texels.
  levels_.make(posed.picture, camera.response, levels_for(4 * most));
  side.noise.listen(posed.pixels(), posed.picture.width, posed.picture.height);

  // What the tint's channels have in common is exposure, to the noise of the sensor as well.
  const double scale = std::min(1 / (exposure * tint * camera.gain), kLargestScale);
  const View view{side,
                  texels,
                  halved,
                  posed.mask,
                  scale,
                  float(kRimOfLight * bright_ / scale),
                  glm::vec3(tint / taken.tint),
                  plane};
  leave_out_quiet_tiles(view);
  changed_.assign(tiles_.size(), 0);
  parallel_for(int(tiles_.size()), 8, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      if (i + 1 < end) map_.prefetch(tiles_[std::size_t(i) + 1]);
      changed_[std::size_t(i)] = add_tile(view, tiles_[std::size_t(i)]);
    }
  });
  for (std::size_t i = 0; i < tiles_.size(); ++i)
    if (changed_[i]) {
      changed.push_back(tiles_[i]);
      views_.eyes[std::size_t(tiles_[i])] = eye;
      if (plane && !map_.above(tiles_[i])) views_.plane_seen[std::size_t(tiles_[i])] = 1;
    }
  return true;
}

void Capture::learn_layout(const PosedPicture& posed, double exposure) {
  const TileOutlines& outlines = map_.geometry.outlines;
  if (const auto surface = place_.find_surface(posed)) {
    const Surroundings before = place_.move_to(*surface, outlines);
    const std::vector<int> from = move_map(before, place_, views_, map_);
    views_.move(from), scale_.move(from);
    fills_.renew(time_, map_);
  }
  const std::vector<int> moved = place_.locate_lights(posed, outlines, exposure, bright_, time_);
  if (moved.empty()) return;
  for (const LightPosition& light : place_.tracks().positions())
    fills_.refill(forget_light(light, moved, place_, bright_, map_), map_);
}

void Capture::turn(const glm::dmat3& new_from_old) {
  check(is_rotation(new_from_old, 1e-3), "a map can only be turned by a rotation");
  turn_map(new_from_old, map_);
  place_.turn(new_from_old, map_.geometry.outlines);
  views_.mix(), scale_.mix();
  fills_.turn(time_, map_);
}

void Capture::distrust(const glm::dvec3& log_change) {
  const glm::dvec3 size = glm::abs(log_change);
  map_.distrust(std::max({size.x, size.y, size.z}));
  changes_.add(time_, log_change);
}

bool Capture::read_meter(const PosedPicture& posed, KnownCamera& known, const Taken& taken) {
  if (!meter_.read(posed, taken, time_)) return false;
  if (!std::exchange(known.metered, true)) scale_.know(known.first);
  fills_.measure_plane(*meter_.irradiance());
  return true;
}

double Capture::scale_error() const {
  if (!cameras_.any_assumed()) return 0;
  const glm::dvec3 sky = map_.seen_sky_irradiance() + fills_.sky_irradiance(map_);
  return fastibl::scale_error(sky, meter_.irradiance());
}

std::shared_ptr<const Environment> Capture::environment() {
  const std::shared_ptr<Environment> environment = snapshots_.take(map_);
  environment->time = time_;
  environment->centre = options_.centre, environment->box = place_.told_box();
  environment->plane_irradiance = meter_.irradiance();
  environment->light_positions = place_.tracks().positions();
  const MapShares shares = shares_of(map_, fills_);
  environment->coverage = shares.coverage, environment->clipped = shares.clipped;
  const PlaceLayout::Parallax parallax = place_.parallax();
  environment->knowledge = shares.knowledge;
  MapKnowledge& knowledge = environment->knowledge;
  knowledge.parallax = parallax.expected, knowledge.parallax_doubt = parallax.doubt;
  knowledge.metered = meter_.irradiance().has_value();
  knowledge.weighed = options_.most_boost > 1 && knowledge.metered;
  knowledge.scale = scale_error();
  const ErrorInterval error = expected_error(knowledge);
  environment->predicted_error = error.expected;
  environment->predicted_low = error.low, environment->predicted_high = error.high;
  return environment;
}

void Capture::find_bands(const std::vector<TexelView>& bands, float height) {
  roll_.assign(std::size_t(map_.grid().count()), Roll{});
  if (bands.size() == 1) return;
  const float step = 2.0f / float(map_.grid().size), count = float(bands.size());
  const float none[16] = {};
  for (const int tile : tiles_) {
    const FaceRect r = tile_rect(map_.grid(), tile);
    const float s = 0.5f * step * float(r.x0 + r.x1) - 1, t = 0.5f * step * float(r.y0 + r.y1) - 1;
    const TexelGroup middle{r.face, s, t, 0, none, none, 1, 1, place_.surroundings().depth(tile)};
    const auto pixel_in = [&](int band) {
      return bands[std::size_t(band)].pixel(middle, map_.above(tile));
    };
    // These comparisons are false for NaN.
    const auto band_of = [&](float row) {
      const float band = row / height * count;
      return band > 0 ? (band < count ? int(band) : int(count) - 1) : 0;
    };
    // One step of iteration from the row that the half-time pose shows it on.
    const int band = band_of(pixel_in(band_of(pixel_in(int(count) / 2).y)).y);
    const int other = band > 0 ? band - 1 : band + 1;
    const glm::vec2 drift = (pixel_in(other) - pixel_in(band)) * (count / float(other - band));
    Roll& roll = roll_[std::size_t(tile)];
    roll.band = band, roll.row = (float(band) + 0.5f) / count * height;
    const float most = kMostDrift * height;
    if (std::abs(drift.x) < most && std::abs(drift.y) < most) roll.drift = drift / height;
  }
}

// Moves texels off the row whose pose projected them to where their own row shows them.
void Capture::unroll(const Camera& camera, const Roll& roll, int first, int count,
                     Sightings& sightings) const {
  if (roll.drift == glm::vec2(0)) return;
  const float width = float(camera.width), height = float(camera.height);
  for (int i = first; i < first + count; ++i) {
    const float rows = (sightings.y[i] - roll.row) / (1 - roll.drift.y);
    const float x = sightings.x[i] + rows * roll.drift.x, y = sightings.y[i] + rows * roll.drift.y;
    sightings.seen[i] &= (x >= 0) & (y >= 0) & (x < width) & (y < height);
    if (sightings.seen[i]) sightings.x[i] = x, sightings.y[i] = y;
  }
}

// Reads the picture where it shows texels.
bool Capture::look(const View& view, const Depth& depth, int count, bool fine, Sightings& sightings,
                   Samples& samples) const {
  if (!view.mask.empty())
    for (int i = 0; i < count; ++i)
      if (sightings.seen[i])
        sightings.seen[i] = *view.mask.pixel(int(sightings.x[i]), int(sightings.y[i])) != 0;
  if (place_.surroundings().is_usual(depth))
    for (const Disc& disc : hidden_)
      for (int i = 0; i < lanes_of(count); ++i) {
        const float x = sightings.x[i] - disc.x, y = sightings.y[i] - disc.y;
        sightings.seen[i] &= !(x * x + y * y < disc.squared_radius);
      }
  const bool rim = sample_footprints(levels_, sightings, count, view.light, fine, samples);
  if (view.untint != glm::vec3(1))
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < lanes_of(count); ++i) {
        samples.linear[c][i] *= view.untint[c];
        if (samples.fine) samples.spread[c][i] *= view.untint[c];
      }
  if (!view.side.vignettes())
    std::fill_n(samples.radiance_per_linear, lanes_of(count), float(view.scale));
  else
    for (int i = 0; i < lanes_of(count); ++i)
      samples.radiance_per_linear[i] =
          sightings.seen[i] ? float(view.scale / view.side.vignette(sightings.x[i], sightings.y[i]))
                            : 1.0f;
  return rim;
}

TileSighting Capture::sighting(const View& view, int tile, const Sightings& sightings,
                               const Samples& samples, int first, int count) const {
  TileSighting s{time_, float(view.scale), float(view.scale), most_pixels_[std::size_t(tile)]};
  if (view.side.vignettes())
    for (int i = first; i < first + count; ++i)
      if (sightings.seen[i]) {
        s.least_scale = std::min(s.least_scale, samples.radiance_per_linear[i]);
        s.most_scale = std::max(s.most_scale, samples.radiance_per_linear[i]);
      }
  return s;
}

// Near things are seen in other directions from far off: pictures of a 360° camera that is carried
// through a room only fill in what those beside the object did not see. A light whose place is
// known is not left out.
void Capture::leave_out_far_tiles(const glm::dvec3& eye) {
  const double distance = glm::length(eye - options_.centre);
  std::erase_if(tiles_, [&](int tile) {
    const double nearer = glm::length(views_.eyes[std::size_t(tile)] - options_.centre);
    return map_.above(tile) && map_.was_seen_whole(tile) &&
           place_.surroundings().is_usual(place_.surroundings().depth(tile)) &&
           distance > kFarther * nearer + kFartherBy;
  });
}

void Capture::leave_out_quiet_tiles(const View& view) {
  // Groups that are seen alike: by band of rows, face and side of the horizon.
  std::vector<std::vector<int>> groups(12 * view.halved.size());
  for (const int tile : tiles_)
    if (map_.quiet.may_leave_out(tile, time_) &&
        place_.surroundings().is_usual(place_.surroundings().depth(tile))) {
      const int group = 2 * (tile / map_.grid().per_face()) + map_.above(tile);
      groups[std::size_t(12 * roll_[std::size_t(tile)].band + group)].push_back(tile);
      prefetch_items(map_.quiet.value(tile, 0), 6 * QuietTiles::kProbes);
    }
  constexpr int kTiles = kTexelLanes / QuietTiles::kProbes;
  struct Part {
    const int* tiles;
    int count;
  };
  std::vector<Part> parts;
  for (const std::vector<int>& group : groups)
    for (int i = 0; i < int(group.size()); i += kTiles)
      parts.push_back({&group[std::size_t(i)], std::min(kTiles, int(group.size()) - i)});
  if (parts.empty()) return;
  left_out_.assign(std::size_t(map_.grid().count()), 0);
  parallel_for(int(parts.size()), 2, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      const Part& part = parts[std::size_t(i)];
      compare_probes(view, part.tiles, part.count);
    }
  });
  std::erase_if(tiles_, [&](int tile) { return left_out_[std::size_t(tile)] != 0; });
}

void Capture::compare_probes(const View& view, const int* tiles, int count) {
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
  const TexelView& halved = view.halved[std::size_t(roll_[std::size_t(tiles[0])].band)];
  if (!halved.see(group, map_.above(tiles[0]), sightings)) return;
  for (int t = 0; t < count; ++t)
    unroll(view.side.camera, roll_[std::size_t(tiles[t])], t * kProbes, kProbes, sightings);
  Samples samples;
  look(view, group.depth, lanes, false, sightings, samples);
  alignas(64) float deviance[kTexelLanes];
  const float* const value[3] = {values[0], values[1], values[2]};
  const float* const variance[3] = {rough[0], rough[1], rough[2]};
  compare_samples(value, variance, lanes, sightings, samples, view.side.noise, deviance);
  for (int t = 0; t < count; ++t) {
    const int tile = tiles[t], at = t * kProbes;
    left_out_[std::size_t(tile)] =
        map_.quiet.leave_out(tile, sighting(view, tile, sightings, samples, at, kProbes),
                             &sightings.seen[at], &deviance[at]);
  }
}

bool Capture::leave_out_seen(int tile, int first, int count, Sightings& sightings) const {
  int left = 0;
  for (int i = 0; i < count; ++i) {
    sightings.seen[i] &= map_.state.last_seen.at(tile, first + i) == kNever;
    left += sightings.seen[i];
  }
  return left > 0;
}

// Takes what the picture shows of a tile; true if it shows any of its texels.
bool Capture::add_tile(const View& view, int tile) {
  const int all = map_.geometry.texels(tile);
  const std::size_t start = map_.geometry.start(tile);
  Sightings sightings;
  Samples samples;
  const TexelView& texels = view.texels[std::size_t(roll_[std::size_t(tile)].band)];
  bool any = false;
  bool whole = true, rim = false;
  float unsure[QuietTiles::kProbes];
  std::fill_n(unsure, QuietTiles::kProbes, -1.0f);
  TileSighting shown{};
  for (int k = 0; k < all; k += kTexelLanes) {
    const int count = std::min(kTexelLanes, all - k);
    const TexelGroup group = map_.geometry.group(tile, k, count, place_.surroundings().depth(tile));
    if (!texels.see(group, sightings)) {
      whole = false;
      continue;
    }
    if (!view.plane && views_.plane_seen[std::size_t(tile)] &&
        !leave_out_seen(tile, k, count, sightings)) {
      whole = false;
      continue;
    }
    unroll(view.side.camera, roll_[std::size_t(tile)], 0, count, sightings);
    rim |=
        look(view, group.depth, count, views_.at_rim[std::size_t(tile)] != 0, sightings, samples);
    const TileSighting part = sighting(view, tile, sightings, samples, 0, count);
    shown = any ? joined(shown, part) : part;
    any = true;
    whole &= std::count(sightings.seen, sightings.seen + count, 0) == 0;
    alignas(64) float left[kTexelLanes];
    // Single texels need times of their own where not all are seen, or not all at once.
    const bool once = count == all && whole && map_.state.last_seen.same(tile);
    merge_samples(map_.state, start + std::size_t(k), count, sightings, samples, view.side.noise,
                  time_, once ? nullptr : map_.state.last_seen.texels(tile) + k,
                  map_.state.last_seen.at(tile, 0), left);
    map_.quiet.add_blocks(k, count, left, unsure);
  }
  if (!any) return false;
  if (view.light < 1) views_.at_rim[std::size_t(tile)] = rim;  // otherwise white is no light
  if (whole) map_.state.last_seen.set(tile, time_);
  relate_variances(map_.state, start, all);
  map_.sum(tile);
  const TileSums& sums = map_.sums[std::size_t(tile)];
  map_.quiet.took(tile, shown, unsure, whole, sums.bound_angle > 0);
  if (sums.count == all) map_.make_levels(tile);
  return true;
}

}  // namespace fastibl
