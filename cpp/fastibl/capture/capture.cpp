#include "fastibl/capture/capture.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fastibl/capture/expected_error.h"
#include "fastibl/capture/map_knowledge.h"
#include "fastibl/capture/map_lacks.h"
#include "fastibl/capture/move_map.h"
#include "fastibl/capture/near_lights.h"
#include "fastibl/capture/probe_level.h"
#include "fastibl/core/check.h"
#include "fastibl/scene/main_lights.h"

namespace fastibl {
namespace {

void check_given(const Picture& picture, const Camera& camera, const Pose& camera_from_marker,
                 const std::optional<double>& exposure, const ImageView<const std::uint8_t>& mask,
                 const std::optional<Pose>& last_row, const glm::dvec3& tint) {
  check(picture.width == camera.width && picture.height == camera.height,
        "the picture must be the camera's ", camera.width, " × ", camera.height, ", got ",
        picture.width, " × ", picture.height);
  check_picture(picture);
  check_rows(mask, "the mask");
  check(mask.data == nullptr ||
            (mask.width == camera.width && mask.height == camera.height && mask.channels == 1),
        "the mask must be the camera's ", camera.width, " × ", camera.height,
        " of one channel, got ", mask.width, " × ", mask.height, " of ", mask.channels);
  camera_from_marker.validate();
  if (last_row) last_row->validate();
  check(!exposure || (*exposure > 0 && std::isfinite(*exposure)),
        "an exposure must be positive and finite, got ", exposure.value_or(0));
  check(tint.x > 0 && tint.y > 0 && tint.z > 0 && std::isfinite(tint.x + tint.y + tint.z),
        "a tint must be positive and finite, got ", tint.x, " ", tint.y, " ", tint.z);
}

constexpr double kMostBoost = 1e4;    // a sun is 1e5 times as bright as its sky
constexpr double kSamePlane = 0.996;  // cosine between planes on which the same light falls

}  // namespace

Capture::Capture(CaptureOptions options)
    : options_(checked(std::move(options))),
      map_(TileGrid{options_.size}),
      views_(map_.grid(), options_.centre),
      place_(options_, map_.geometry.outlines),
      fills_(options_, map_),
      meter_(options_.board, options_.paper_albedo),
      scale_(map_.grid()) {}

Taken Capture::add(const Picture& picture, const Camera& camera, const Pose& camera_from_marker,
                   std::optional<double> exposure, double time, ImageView<const std::uint8_t> mask,
                   const std::optional<Pose>& last_row, const glm::dvec3& tint, bool plane,
                   int number) {
  check_given(picture, camera, camera_from_marker, exposure, mask, last_row, tint);
  check(std::isfinite(time) && time >= time_, "time must not run backwards: ", time, " s after ",
        time_, " s");
  KnownCamera& known = cameras_.get(camera, number, map_.grid().size);
  // Pictures without times of their own are stills, not a film.
  const bool still = time == time_ && last_camera_ == camera;
  const int refills = fills_.refills_after(time, still);
  time_ = time;
  if (last_camera_ != camera) last_camera_ = camera;
  const GivenPicture given{picture, RowPoses(camera_from_marker, last_row), mask};
  const double bright = MainLightOptions{}.brightness * fills_.mean_radiance(map_);
  const Taken taken = judge(given, exposure, tint, plane, known);
  if (taken.as == TakenAs::left_out) return taken;
  ++changes_made_;
  const Taking how{taken, time, bright, plane, clips_in_all(taken, known)};
  std::vector<int> changed;
  bool any = false, metered = false;
  known.each_side(given, [&](const PosedPicture& posed) {
    if (plane) learn_layout(posed, how);
    any |= PictureTaker(posed, how, place_, map_, views_, levels_).take(changed);
    metered = known.perspective() && plane && read_meter(posed, known, taken);
  });
  const bool assumed = known.doubt.assumed() && !known.metered;
  scale_.note(changed, assumed ? known.first : 0, !exposure);
  if (metered && !fills_.has_prior() && fills_.clipped_lights().boosted() == 0)
    scale_.mend(map_, *meter_.irradiance(), time_, changed);
  fills_.boost_up_to(meter_.irradiance() ? most_boost() : 1);
  if (any) fills_.take(changed, refills, meter_.irradiance(), time_, map_);
  return taken;
}

bool Capture::clips_in_all(const Taken& taken, KnownCamera& known) const {
  const bool shortest = known.note_exposure(taken.exposure);
  return shortest && (options_.most_boost || known.brackets());
}

double Capture::most_boost() const {
  if (options_.most_boost) return *options_.most_boost;
  // An unknown scale and unknown lights cannot both be told from the board's white.
  return cameras_.any_brackets() && !cameras_.any_assumed() ? kMostBoost : 1;
}

Taken Capture::judge(const GivenPicture& given, std::optional<double> exposure,
                     const glm::dvec3& tint, bool plane, KnownCamera& known) {
  Taken taken{.exposure = exposure.value_or(1)};
  ExposureDoubt& doubt = known.doubt;
  if (exposure) doubt.tell();
  if (!exposure || (options_.doubt_exposures && known.perspective())) {
    std::vector<LevelProbe> probes;
    known.each_side(given, [&](const PosedPicture& posed) {
      probe_level(posed, place_, map_, changes_, !exposure, probes);
    });
    for (LevelProbe& p : probes) p.expected *= glm::vec3(tint);
    taken = doubt.judge(probes, exposure, time_);
    if (doubt.found_change()) distrust(*doubt.found_change());
    if (taken.as == TakenAs::left_out) return taken;
    if (taken.as == TakenAs::assumed) {
      if (const auto shown = assumed_exposure(given, known, plane))
        taken.exposure = *shown / grey(tint);
      doubt.assume(taken.exposure);
    }
  }
  taken.tint *= tint;
  return taken;
}

// By the board's white, or else by how bright the picture is.
std::optional<double> Capture::assumed_exposure(const GivenPicture& given, KnownCamera& known,
                                                bool plane) {
  std::optional<double> exposure;
  PictureMean mean;
  known.each_side(given, [&](const PosedPicture& posed) {
    mean.add(posed);
    if (known.perspective() && plane) exposure = meter_.exposure_by_white(posed);
  });
  if (exposure) known.metered = true;
  return exposure ? exposure : meter_.exposure_by_mean(mean);
}

void Capture::learn_layout(const PosedPicture& posed, const Taking& how) {
  const TileOutlines& outlines = map_.geometry.outlines;
  if (const auto surface = place_.find_surface(posed)) {
    const Surroundings before = place_.move_to(*surface, outlines);
    const std::vector<int> from = move_map(before, place_, views_, map_);
    views_.move(from), scale_.move(from);
    fills_.renew(time_, map_);
  }
  const double exposure = how.taken.exposure * how.taken.grey_tint();
  const std::vector<int> moved =
      place_.locate_lights(posed, outlines, exposure, how.bright, how.time);
  if (moved.empty()) return;
  fills_.refill(move_lights(place_.tracks().positions(), moved, place_, how.bright, map_), map_);
}

void Capture::turn(const glm::dmat3& new_from_old) {
  check(is_rotation(new_from_old, 1e-3), "a map can only be turned by a rotation");
  turn_map(new_from_old, map_);
  place_.turn(new_from_old, map_.geometry.outlines);
  views_.mix(), scale_.mix(map_);
  // Another plane now, on which other light falls.
  if (new_from_old[2][2] < kSamePlane) meter_.forget();
  fills_.turn(new_from_old, meter_.irradiance(), time_, map_);
  ++changes_made_;
}

void Capture::distrust(const glm::dvec3& log_change) {
  const glm::dvec3 size = glm::abs(log_change);
  map_.distrust(std::max({size.x, size.y, size.z}));
  changes_.add(time_, log_change);
}

bool Capture::read_meter(const PosedPicture& posed, KnownCamera& known, const Taken& taken) {
  // What another camera showed of the white is not to be replaced by a guess.
  if (known.doubt.assumed() && !known.metered && meter_.irradiance()) return false;
  if (!meter_.read(posed, taken, time_)) return false;
  if (!std::exchange(known.metered, true)) scale_.know(known.first);
  fills_.measure_plane(*meter_.irradiance());
  return true;
}

double Capture::scale_error() const {
  if (!cameras_.any_assumed() && !scale_.any(map_)) return 0;
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
  knowledge.scale = scale_error();
  const ErrorInterval error = expected_error(knowledge);
  environment->predicted_error = error.expected;
  environment->predicted_low = error.low, environment->predicted_high = error.high;
  return environment;
}

double Capture::next_exposure(const Camera& camera, const Pose& camera_from_marker,
                              const ExposureRange& range) const {
  check(camera.model == CameraModel::perspective,
        "the next exposure is chosen for perspective cameras only");
  camera.validate();
  check(range.shortest > 0 && range.longest >= range.shortest && std::isfinite(range.longest),
        "exposures must range from a positive one to a longer one, got ", range.shortest, " to ",
        range.longest);
  const ViewLacks view = lacks_in_view(camera, camera_from_marker, options_.centre, map_);
  const double mean = view.mean.value_or(fills_.mean_radiance(map_));
  // An empty map says nothing of the light. What clips at the longest exposure asks for a shorter
  // one next.
  return mean > 0 ? fastibl::next_exposure(view.lacks, mean, range, camera.gain) : range.longest;
}

}  // namespace fastibl
