#include "fastibl/capture/exposure_doubt.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

constexpr double kTolerance = 0.18;    // ln: a fifth brighter or darker is nothing to wonder about
constexpr double kUniform = 0.3;       // spread of ln within a picture that is off as a whole
constexpr double kUsable = 0.6;        // the same for one that an exposure is read from
constexpr double kSame = 0.15;         // ln: up to this, two pictures are off alike
constexpr double kStays = 0.2 - 1e-6;  // seconds, allowing for times' rounding, and
constexpr int kPictures = 4;           // pictures: what is off for so long is the place

glm::dvec3 log_of(const PictureLevel& level, double told) {
  return glm::dvec3(std::log(level.exposure / told)) + glm::log(level.tint);
}
double largest(const glm::dvec3& v) {
  return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

}  // namespace

// What the map is not sure of still tells more than nothing: a camera whose pictures alone show a
// place would else stay out once that place is in doubt.
Taken ExposureDoubt::without_word(std::span<const LevelProbe> sure, std::span<const LevelProbe> all,
                                  double time) {
  const auto estimated = [](const PictureLevel& level) -> Taken {
    return {TakenAs::estimated, level.exposure, glm::dvec3(1), level.deviation(), 0, level.count};
  };
  std::optional<PictureLevel> level = fit_level(sure);
  if (!level) level = fit_level(all);
  if (level && level->spread <= kUsable) {
    doubt_.reset();
    return estimated(*level);
  }
  if (!level) level = fit_shown(all);
  const int count = int(all.size());
  const bool unknown = !level && count < kLeastProbes;
  const bool stays = (level || unknown) && confirmed({}, time);
  if (level && stays) return estimated(*level);
  // Of pictures in a row, only the first may set the scale of what the map does not know.
  const bool assume = unknown && (stays || !placed_);
  return {assume ? TakenAs::assumed : TakenAs::left_out,
          assume ? last_ : 1,
          glm::dvec3(1),
          0,
          0,
          count};
}

// Whether pictures have been off alike for so long that the place has changed. log_ratio: empty
// where a picture only tells that it is off.
bool ExposureDoubt::confirmed(const std::optional<glm::dvec3>& log_ratio, double time) {
  const bool same = doubt_ && (!log_ratio || !doubt_->log_ratio ||
                               largest(*log_ratio - *doubt_->log_ratio) <= kSame);
  if (!same) doubt_ = Doubt{log_ratio, time, 0};
  if (log_ratio) doubt_->log_ratio = log_ratio;
  ++doubt_->pictures;
  if (!(doubt_->pictures >= kPictures && time - doubt_->since >= kStays)) return false;
  if (!doubt_->believed && doubt_->log_ratio) {  // otherwise it may be a hand
    change_ = doubt_->log_ratio;
    flicker_ = {};  // it compared with the map as it was
    doubt_->believed = true;
  }
  return true;
}

Taken ExposureDoubt::judge(std::span<LevelProbe> all, std::optional<double> told, double time) {
  const auto unsure =
      std::partition(all.begin(), all.end(), [](const LevelProbe& p) { return p.sure; });
  const std::span<const LevelProbe> probes(all.begin(), unsure);
  Taken taken;
  change_.reset();
  if (!told) {
    taken = without_word(probes, all, time);
    placed_ |= taken.as != TakenAs::left_out;
    assumed_ |= taken.as == TakenAs::assumed;
    if (taken.as != TakenAs::left_out) last_ = taken.exposure;
    return taken;
  }
  taken.exposure = *told, taken.probes = int(probes.size());
  const std::optional<PictureLevel> level = fit_level(probes);
  if (!level) {  // no word on past doubts either
    if (is_far_off(probes, *told) && !confirmed({}, time)) taken.as = TakenAs::left_out;
    return taken;
  }
  const glm::dvec3 ratio = log_of(*level, *told);
  FlickerWatch::Levelled levelled;
  if (level->spread <= kUniform && flicker_.watch(*told, (ratio.x + ratio.y + ratio.z) / 3,
                                                  level->deviation(), time, levelled)) {
    doubt_.reset();
    return {TakenAs::averaged, *told * std::exp(levelled.log_factor),
            glm::dvec3(1),     level->deviation(),
            levelled.swing,    level->count};
  }
  if (level->spread > kUniform || largest(ratio) <= kTolerance) {
    doubt_.reset();
    return taken;
  }
  if (confirmed(ratio, time)) return taken;
  return {TakenAs::corrected, level->exposure, level->tint, level->deviation(), 0, level->count};
}

}  // namespace fastibl
